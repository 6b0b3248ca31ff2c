"""What is observed of a few coordinates, and perhaps of multipliers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.local import SX, Local


@dataclass(frozen=True)
class ObservedKernel:
    """Columns observed of one copy: a function of local time, q, v, data and lam."""

    local: Local
    value: SX
    reused: ClassVar[bool] = False

    @property
    def inputs(self) -> list[SX]:
        """(time, q, v, data, lam), what it may depend on."""
        x = self.local
        return [x.time, x.q, x.v, x.data, x.lam]

    @property
    def outputs(self) -> list[SX]:
        """The columns alone."""
        return [self.value]

    @classmethod
    def stated(cls, local: Local, outputs: list[SX]) -> ObservedKernel:
        """The kernel of these `outputs`."""
        (value,) = outputs
        return cls(local, value)

    @cached_property
    def function(self) -> RowFunction:
        """Rows of `inputs` -> rows of the columns."""
        return RowFunction(ca.Function("observed", self.inputs, [ca.densify(self.value)]))


class ObservedStatement(NamedTuple):
    """A kernel of what is observed, and its data, a column."""

    kernel: ObservedKernel
    data: np.ndarray
