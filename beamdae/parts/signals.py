"""Inputs, sensors and states: values that formulas of parts can contain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from inspect import Parameter, signature
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import (
    BeamdaeError,
    as_real,
    convert_fields,
    require_finite,
    require_positive,
    require_unit,
    set_fields,
    short_repr,
)
from beamdae.parts.laws import Law, as_law
from beamdae.parts.part import Part
from beamdae.symbolic.local_symbols import SX, Local
from beamdae.symbolic.signals import Signal, as_expression, find_other_symbols, find_signals
from beamdae.symbolic.statements import (
    LOAD_UNITS,
    ForceKernel,
    ForceStatement,
    Piece,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)

NO_UNIT = "-"
_ONE_ROW = sp.csr_array(np.eye(1))
_STATE_AND_TIME = 2  # parameters of the rate of a state that depends on itself
_NO_DATA = np.zeros((0, 1))


class Value(Signal):
    """Signal that is also a function of time, so that it is accepted wherever a law is."""

    unit: str

    def __call__(self, t: Any) -> Any:
        """Return the symbol; for a number t [s], the value at which formulas are checked."""
        return self.value_symbol if as_real(t) is None else self.reference

    @property
    def quantity(self) -> Quantity:
        """The value as an observable with one column."""
        return Quantity((Variable("", self.unit),), (), lambda local: self.value_symbol)


@dataclass(frozen=True, eq=False)
class Input(Value):
    """Input of a mechanism, created by `Mechanism.input`.

    Its value is a number of the equations of motion, or a law of time. It is used wherever a law is
    accepted and in the formulas of laws.

    Attributes
    ----------
    name, unit
        Name and unit.
    default
        Value: a number or a `Law`.
    pieces
        Coordinate of the controller that drives the input; empty if there is none.
    """

    name: str
    default: Any = 0.0
    unit: str = "-"
    pieces: tuple[Piece, ...] = field(default=(), init=False, repr=False)

    def __post_init__(self) -> None:
        value = self.default
        if as_real(value) is None and not callable(value):
            raise BeamdaeError(
                f"{self.name}: default must be a number or a law of time, got {short_repr(value)}."
            )
        if callable(value):
            set_fields(self, default=as_law(self.name, value))
        else:
            set_fields(self, default=require_finite(self.name, "default", value))
        set_fields(self, unit=require_unit(self.name, self.unit))

    @property
    def law(self) -> Law | None:
        """Law of time; None if the value is a number."""
        return self.default if isinstance(self.default, Law) else None

    @property
    def reference(self) -> float:
        """Value at t = 0."""
        law = self.law
        return self.default if law is None else law.at(0.0)

    @property
    def rows(self) -> int:
        """One coordinate if a controller drives the input, otherwise none."""
        return len(self.pieces)

    @property
    def data(self) -> Sequence[float]:
        """The number; 0 if a law is added to it, and none if a controller drives the input."""
        if self.pieces:
            return ()
        return (self.default if self.law is None else 0.0,)

    def express(self, local: Local) -> SX:
        """Return the number, or the value that a controller holds."""
        return local.q if self.pieces else local.data


@dataclass(frozen=True, eq=False)
class Activity(Signal):
    """Factor of a measured load: 1 while its part is active, otherwise 0.

    Attributes
    ----------
    name
        Name of the part.
    """

    name: str
    reference = 1.0
    data = (1.0,)

    def express(self, local: Local) -> SX:
        """Return the factor."""
        return local.data


@dataclass(frozen=True, eq=False)
class Sensor(Value):
    """Measured value, created by `Mechanism.sensor`.

    Attributes
    ----------
    name, unit
        Name and unit.
    of
        Measured quantity.
    column
        Index of the column of the quantity.
    """

    name: str
    of: Quantity
    column: int
    unit: str = "-"

    def __post_init__(self) -> None:
        if self.of.has_accelerations:
            raise BeamdaeError(
                f"{self.name}: a sensor cannot measure accelerations, which follow from the "
                "forces; measure a position or a velocity."
            )
        if self.of.joint is not None:
            raise BeamdaeError(
                f"{self.name}: a sensor cannot measure the reaction of a joint; measure a "
                "deformation or a motion, or observe the reaction. After a run, "
                "solution.energies['energy.work_of_drivers [J]'] contains the work of drivers."
            )

    @property
    def quantity(self) -> Quantity:
        """The measured column as an observable."""
        return self._column if self.of.can_be_rebuilt else self._select_column()

    @property
    @rebuilt_for_mesh
    def _column(self) -> Quantity:
        return self._select_column()

    def _select_column(self) -> Quantity:
        of, k = self.of.current, self.column
        variable = Variable("", self.unit)
        return Quantity(
            (variable,),
            of.pieces,
            lambda local: of.expression(local)[k],
            of.data,
            load_of=of.load_of,
            is_magnitude=of.is_magnitude,
            is_elastic=of.is_elastic,
        )

    @cached_property
    def activity(self) -> Activity | None:
        """Factor of a measured load, which is zero while its part is inactive."""
        if self.of.load_of is None or self.unit not in LOAD_UNITS:
            return None
        return Activity(self.of.load_of)

    @property
    def rows(self) -> int:
        """Number of local coordinates of the quantity."""
        return sum(piece.operator.shape[0] for piece in self.of.current.pieces)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """Pieces of the quantity."""
        return self.of.current.pieces

    @property
    def data(self) -> Sequence[float]:
        """Numbers of the quantity."""
        return self.of.current.data.tolist()

    def express(self, local: Local) -> SX:
        """Return the measured column."""
        value = self.of.current.expression(local)[self.column]
        return value if self.activity is None else value * self.activity.value_symbol


@dataclass(frozen=True, eq=False)
class State(Part, Value):
    """First-order state x' = rate, created by `Mechanism.state`.

    x is a coordinate without inertia. Its row of the equations of motion is x' - rate = 0; at rest,
    an equilibrium satisfies rate = 0. The state has no energy and receives no forces.

    Attributes
    ----------
    name, unit
        Name and unit.
    rate
        Rate [unit/s]: a number, a law of time, a formula of inputs, sensors and states, or a
        function (x, t) of the state itself; None until `follows` defines it.
    start
        Value at the start.
    scale
        Typical size, in `unit`, to which error tolerances refer.
    """

    name: str
    rate: Any = None
    start: float = 0.0
    unit: str = "-"
    scale: float = 1.0
    laws: tuple[Law, ...] = field(init=False, default=())
    is_state = True
    rows = 1

    def __post_init__(self) -> None:
        convert_fields(self, start=require_finite, scale=require_positive)
        set_fields(self, unit=require_unit(self.name, self.unit))
        if self.rate is not None:
            self.follows(self.rate)

    def follows(self, rate: Any) -> None:
        """Set the rate, for states that depend on each other.

        Parameters
        ----------
        rate
            Rate as in `Mechanism.state`.

        Raises
        ------
        BeamdaeError
            If `rate` is not a valid formula.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism()
        >>> position = mech.state("position", start=1.0)
        >>> velocity = mech.state("velocity", lambda velocity, t: -4.0 * position)
        >>> position.follows(velocity)
        """
        law = rate
        if callable(rate) and not isinstance(rate, (Law, Signal)) and _takes_two(rate):
            law = Law((lambda t: rate(self, t),))
        set_fields(self, rate=rate, laws=(as_law(self.name, law),))

    @property
    def reference(self) -> float:
        """Value at the start."""
        return self.start

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """The state, named "value"."""
        return (Variable("value", self.unit),)

    @property
    def initial_position(self) -> np.ndarray:
        """Value at the start, shape (1,)."""
        return np.array([self.start])

    @property
    def initial_velocity(self) -> np.ndarray:
        """Zero; the rate at the start follows from the formula."""
        return np.zeros(1)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The coordinate."""
        return (Piece(self, _ONE_ROW),)

    def express(self, local: Local) -> SX:
        """Return the coordinate."""
        return local.q

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return the row x' - rate."""
        if not self.laws:
            raise BeamdaeError(
                f"{self.name}: the state has no rate; pass rate= or call {self.name}.follows(rate)."
            )
        local = Local(1)
        force = local.v - self.laws[0](local.time)
        return [ForceStatement(self.name, ForceKernel(local, force), self.pieces, _NO_DATA)]


def _takes_two(function: Any) -> bool:
    """Return True if a function has two parameters without default."""
    try:
        parameters = signature(function).parameters.values()
    except (TypeError, ValueError):
        return False
    required = [x for x in parameters if x.default is Parameter.empty]
    return len(required) == _STATE_AND_TIME


def require_formula(part: str, name: str, value: Any) -> SX:
    """Return a number, or a formula of inputs, sensors and states, as an expression.

    Raises
    ------
    BeamdaeError
        If the value is neither a finite number nor one such formula.
    """
    if as_real(value) is not None:
        return SX(require_finite(part, name, value))
    expression = as_expression(value)
    if (
        not isinstance(expression, SX)
        or expression.shape != (1, 1)
        or find_other_symbols(expression)
    ):
        raise BeamdaeError(
            f"{part}: {name} must be a number or a formula of inputs, sensors and states, got "
            f"{short_repr(value)}."
        )
    return expression


def find_unit(name: str, value: SX, unit: str | None) -> str | None:
    """Return the given unit, or the one of the signals of which `value` is a sum, or None."""
    if unit is not None:
        return require_unit(name, unit)
    signals = [x for x in find_signals(value) if isinstance(x, Value)]
    # Inputs and states have no unit by default, but sensors of strains are dimensionless.
    units = {x.unit for x in signals if x.unit != NO_UNIT or isinstance(x, Sensor)}
    if len(units) != 1:
        return None
    factors = ca.jacobian(value, ca.vertcat(*(x.value_symbol for x in signals)))
    is_sum = factors.is_constant() and np.all(np.abs(ca.DM(factors).full()) == 1.0)
    return units.pop() if is_sum else None
