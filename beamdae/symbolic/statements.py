"""Local statements of mechanics: what one part says about a few coordinates.

A statement is a small symbolic kernel together with constant sparse operators that pick its local
coordinates from those of the bodies it concerns. The equations of motion of a mechanism are the
sum of the statements of its parts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.constraint_kernel import ConstraintKernel
from beamdae.symbolic.force_kernel import ForceKernel
from beamdae.symbolic.local_symbols import SX, Local, column_misfit
from beamdae.symbolic.nonholonomic_kernel import NonholonomicKernel

__all__ = [
    "SX",
    "ConstraintKernel",
    "ConstraintStatement",
    "ForceKernel",
    "ForceStatement",
    "Local",
    "Named",
    "NonholonomicKernel",
    "Piece",
    "Quantity",
    "QuantityKernel",
    "RangeKernel",
    "RangeStatement",
]


class Named(NamedTuple):
    """A name and its unit: of a coordinate, a multiplier or an observed column."""

    name: str
    unit: str

    @property
    def header(self) -> str:
        """'name [unit]', as tables have it."""
        return f"{self.name} [{self.unit}]"

    @property
    def rate(self) -> Named:
        """Its rate of change."""
        return Named(f"{self.name}_dot", "1/s" if self.unit == "-" else f"{self.unit}/s")


class Piece(NamedTuple):
    """Rows of a constant operator on the coordinates of one owner (a body, or a joint's lam).

    `s` is the arc length [m] of the section whose coordinates they are, where the owner is a beam.
    """

    owner: Any
    operator: sp.csr_array
    s: float | None = None


@dataclass(frozen=True)
class ForceStatement:
    """`count` copies of one force kernel: `data` has one column a copy.

    Each piece's operator stacks the local rows of copy 0, copy 1, ... so that it has
    count * rows rows; the pieces of one copy follow each other in the local coordinates. `joint`
    names the part whose multipliers are local.lam, if any.
    """

    part: str
    kernel: ForceKernel
    pieces: tuple[Piece, ...]
    data: np.ndarray
    joint: str | None = None

    @property
    def count(self) -> int:
        """Number of copies."""
        return self.data.shape[1]


@dataclass(frozen=True)
class ConstraintStatement:
    """Constraints of one part; `multipliers` names what each row of g holds, in the unit of lam."""

    part: str
    kernel: ConstraintKernel
    pieces: tuple[Piece, ...]
    multipliers: tuple[Named, ...]
    data: np.ndarray = field(default_factory=lambda: np.zeros((0, 1)))


@dataclass(frozen=True)
class RangeKernel:
    """How far one copy of a statement has gone from where it holds.

    Attributes
    ----------
    local
        Symbols.
    values
        (deflection over length [-], rotation [rad], strain [-]) from local.q and local.data, all
        positive or zero.
    """

    local: Local
    values: SX

    # Rotations follow no law of time.
    has_branches = False

    @cached_property
    def misfit(self) -> str:
        """What is wrong with its expression, a phrase, or nothing."""
        return column_misfit("values", self.values, 3, self.local.q, self.local.data)

    @cached_property
    def function(self) -> RowFunction:
        """Rows of (q, data) -> rows of `values`."""
        inputs = [self.local.q, self.local.data]
        return RowFunction(ca.Function("range", inputs, [ca.densify(self.values)]))


@dataclass(frozen=True)
class RangeStatement:
    """What of a part tells how far its strains are to be trusted.

    Pieces, copies and `data` as in `ForceStatement`.

    Attributes
    ----------
    error
        (a, b): at a rotation of r [rad] its deformation is off by a r + b r^2 of itself; None if
        its strains have no limit.
    remedies
        What helps besides cutting it into several bodies, as settings.
    """

    part: str
    kernel: RangeKernel
    pieces: tuple[Piece, ...]
    data: np.ndarray
    error: tuple[float, float] | None = None
    remedies: tuple[str, ...] = ()


@dataclass(frozen=True)
class Quantity:
    """Something observed: columns computed from a few coordinates, and perhaps multipliers.

    Attributes
    ----------
    columns
        What each value is; an empty name stands for the observable's own.
    pieces
        Where the local coordinates come from.
    expression
        local -> SX of shape (len(columns),).
    data
        Values of local.data, shape (n_data,).
    joint
        Name of the part whose multipliers are local.lam, or None.
    """

    columns: tuple[Named, ...]
    pieces: tuple[Piece, ...]
    expression: Callable[[Local], SX]
    data: np.ndarray = field(default_factory=lambda: np.zeros(0))
    joint: str | None = None


@dataclass(frozen=True)
class QuantityKernel:
    """Values of a quantity.

    Attributes
    ----------
    local
        Symbols.
    values
        From time, q, v, data and lam of these, shape (number of columns,).
    """

    local: Local
    values: SX
    reused: ClassVar[bool] = False

    @property
    def inputs(self) -> list[SX]:
        """(time, q, v, data, lam), what they may depend on."""
        x = self.local
        return [x.time, x.q, x.v, x.data, x.lam]

    @property
    def outputs(self) -> list[SX]:
        """The values alone."""
        return [self.values]

    @classmethod
    def stated(cls, local: Local, outputs: list[SX]) -> QuantityKernel:
        """The kernel of these `outputs`."""
        (values,) = outputs
        return cls(local, values)

    @cached_property
    def function(self) -> RowFunction:
        """Rows of (time, q, v, data, lam) -> rows of values."""
        return RowFunction(ca.Function("observed", self.inputs, [ca.densify(self.values)]))
