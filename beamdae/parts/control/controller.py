"""Sampled controllers: Python functions that set inputs at equal intervals of time."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp

from beamdae.errors import (
    MAX_MAGNITUDE,
    BeamdaeError,
    as_real,
    convert_fields,
    format_exception,
    require_count,
    require_finite,
    require_name,
    require_positive,
    require_sequence,
    set_fields,
    short_repr,
)
from beamdae.parts.attachments import Attachment
from beamdae.parts.forces.formula_checks import require_function
from beamdae.parts.observables import as_quantity
from beamdae.parts.part import Part
from beamdae.parts.signals import Input, Value
from beamdae.symbolic.statements import (
    ForceKernel,
    ForceStatement,
    Local,
    Piece,
    Quantity,
    Variable,
)

Array = np.ndarray
_FLOATS = (float, np.float64)
# Laws that have not repeated a sample, with the sentence of the run that failed.
_laws_with_memory: WeakKeyDictionary[Callable[[Sample], Any], str] = WeakKeyDictionary()
_MAX_DELAY = 1000  # samples; each adds one coordinate per driven input


@dataclass
class Sample:
    """One sample of a `Controller`, the argument of its law.

    Attributes
    ----------
    t
        Time of the sample [s].
    index
        Number of the sample, t = index * every.
    every
        Interval between samples [s].
    reads
        Measured values, (number of read columns,).
    state
        Discrete state of the law, which the law may change in place; it is kept until the next
        sample.
    """

    t: float
    index: int
    every: float
    reads: Array
    state: Array
    seed: tuple[int, int, int] = field(repr=False)

    @cached_property
    def random(self) -> np.random.Generator:
        """Random numbers of this sample; the same in every run with the same `seed`."""
        return np.random.default_rng(self.seed)


@dataclass(frozen=True, eq=False)
class Controller(Part):
    """Sampled controller: a Python function that sets inputs, which are held between samples.

    At t = 0, `every`, 2 `every`, ..., the law receives the measured values and returns the values
    of the driven inputs. Integrators end a step at each sample and continue with the new values.
    The held values and the discrete state of the law are coordinates of the mechanism: they are
    part of results, saved runs and restarts, and the law is a pure function of its argument: memory
    belongs to the state of the sample, because pilot runs call the law, too.

    Parameters
    ----------
    name
        Unique name.
    every
        Interval between samples [s].
    reads
        Sensors, states, inputs, quantities or attachments; the law receives all their columns.
    drives
        Inputs of the mechanism whose values are numbers. Until the first delayed value arrives,
        they keep their defaults. They may define forces and rates of states, but no constraints.
    law
        Function of a sample with the attributes `t` [s], `index`, `every`, `reads` (array),
        `state` (array, which the law may change in place) and `random`, a NumPy generator for
        noise. It returns one number per driven input (for one input, a number).
    state
        Initial values of the discrete state.
    delay
        Number of whole samples after which the values take effect, at most 1000.
    seed
        Seed of the random numbers. Those of several controllers are independent.

    Raises
    ------
    BeamdaeError
        If an argument is invalid. `Mechanism.add` raises this error for inputs that are not part of
        the mechanism, have a law or are already driven. A run ends with the status "failed" if the
        law raises an exception, does not return finite numbers of at most 1e75, or returns other
        values if a sample is repeated: samples 0, 1, 2, 4, 8, ... of a run are taken twice, and
        again at its end. Further runs with the same function then raise this error.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=0.5))
    >>> pin = mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    >>> torque = mech.input("torque", unit="N m")
    >>> motor = mech.add(bd.Moment("motor", wheel.at(0.0, 0.0), torque))
    >>> angle = mech.sensor("angle", wheel.at(0.0, 0.0), "angle")
    >>> rate = mech.sensor("rate", wheel.at(0.0, 0.0), "angle_dot")
    >>> def law(sample):
    ...     angle, rate = sample.reads
    ...     return 8.0 * (1.0 - angle) - 4.0 * rate
    >>> servo = mech.add(bd.Controller("servo", 0.05, [angle, rate], [torque], law))
    >>> run = bd.simulate(mech, bd.GeneralizedAlpha(0.01), t_end=3.0)
    >>> print(f"{run['angle'].iloc[-1]:.3f}")
    1.000
    """

    is_controller: ClassVar[bool] = True

    name: str
    every: float
    reads: Any
    drives: Any
    law: Callable[[Sample], Any]
    state: Any = ()
    delay: int = 0
    seed: int = 0
    bodies = ()  # The mechanism checks the parts to which the quantities refer.
    is_state = True  # The values have no inertia.
    scale = 1.0  # The values may have different units.

    def __post_init__(self) -> None:
        name = require_name("Controller", self.name)
        require_function(name, "law", self.law)
        what = "a list of sensors, states, quantities or attachments"
        reads = [self.reads] if _is_readable(self.reads) else self.reads
        reads = require_sequence(name, "reads", reads, what)
        drives = [self.drives] if isinstance(self.drives, Input) else self.drives
        drives = require_sequence(name, "drives", drives, "a list of inputs")
        for read in reads:
            if not _is_readable(read):
                raise BeamdaeError(f"{name}: reads must be {what}, got {short_repr(read)}.")
        for drive in drives:
            if not isinstance(drive, Input) or drive.law is not None:
                raise BeamdaeError(
                    f"{name}: drives must be inputs of the mechanism with numbers as default, got "
                    f"{short_repr(drive)}."
                )
        if not drives:
            raise BeamdaeError(f"{name}: drives must contain at least one input.")
        state = require_sequence(name, "state", self.state, "a list of numbers")
        convert_fields(
            self,
            every=require_positive,
            delay=partial(require_count, least=0, most=_MAX_DELAY),
            seed=partial(require_count, least=0),
        )
        set_fields(
            self,
            name=name,
            reads=tuple(reads),
            drives=tuple(drives),
            state=tuple(require_finite(name, "state", x) for x in state),
        )

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Quantities that the law reads."""
        quantities = tuple(as_quantity(self.name, read) for read in self.reads)
        if any(quantity.joint is not None for quantity in quantities):
            raise BeamdaeError(
                f"{self.name}: a controller cannot read the reaction of a joint; read a "
                "deformation or a motion."
            )
        if any(quantity.has_accelerations for quantity in quantities):
            raise BeamdaeError(
                f"{self.name}: a controller cannot read accelerations, which follow from the "
                "forces; read a position or a velocity."
            )
        return quantities

    @property
    def coordinates(self) -> tuple[Variable, ...]:
        """Driven values, values that wait for their delay, and the discrete state."""
        driven = [Variable(x.name, x.unit) for x in self.drives]
        waiting = [
            Variable(f"{x.name} after {k + 1}", x.unit)
            for k in range(self.delay)
            for x in self.drives
        ]
        state = [Variable(f"state{k + 1}", "-") for k in range(len(self.state))]
        return (*driven, *waiting, *state)

    @property
    def initial_position(self) -> Array:
        """Defaults of the inputs, and the initial state."""
        defaults = [x.default for x in self.drives]
        return np.array([*defaults * (1 + self.delay), *self.state], float)

    @property
    def initial_velocity(self) -> Array:
        """Zero: the values are constant between samples."""
        return np.zeros(len(self.coordinates))

    def piece(self, k: int) -> Piece:
        """Return the piece of the value of driven input number `k`."""
        return Piece(self, sp.csr_array(np.eye(len(self.coordinates))[[k]]))

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Return the rows x' = 0 of the held values."""
        n = len(self.coordinates)
        local = Local(n)
        piece = Piece(self, sp.csr_array(np.eye(n)))
        return [ForceStatement(self.name, ForceKernel(local, local.v), (piece,), np.zeros((0, 1)))]

    def _next_values(
        self, t: float, index: int, reads: Array, values: Array, stream: int = 0
    ) -> Array:
        """Return the coordinates after sample number `index` at time `t` [s].

        Parameters
        ----------
        t, index
            Time and number of the sample.
        reads
            Measured values.
        values
            Coordinates before the sample.
        stream
            Number of the controller in the mechanism, for independent random numbers.

        Raises
        ------
        BeamdaeError
            If the law fails or does not return finite numbers of at most 1e75.
        """
        n_driven = len(self.drives)
        n_queue, seed = n_driven * (1 + self.delay), (self.seed, index, stream)
        sample = Sample(t, index, self.every, reads.copy(), values[n_queue:].copy(), seed)
        try:
            result = self.law(sample)
        except Exception as problem:
            raise BeamdaeError(
                f"{self.name}: the law failed at t = {t:g} s: {format_exception(problem)}; correct "
                "the law."
            ) from problem
        is_number = type(result) in _FLOATS or as_real(result) is not None
        numbers = _as_finite_numbers(self.name, [result] if is_number else result)
        if numbers is None or len(numbers) != n_driven:
            raise BeamdaeError(
                f"{self.name}: the law must return one finite number per driven input "
                f"({n_driven}), at most {MAX_MAGNITUDE:g} in absolute value, got "
                f"{short_repr(result)} at t = {t:g} s."
            )
        state = _as_finite_numbers(self.name, sample.state)
        if state is None or len(state) != len(self.state):
            raise BeamdaeError(
                f"{self.name}: the state must consist of {len(self.state)} finite numbers, at "
                f"most {MAX_MAGNITUDE:g} in absolute value, got {short_repr(sample.state)} at "
                f"t = {t:g} s."
            )
        # The first values of the queue are in effect.
        return np.array([*values[n_driven:n_queue].tolist(), *numbers, *state])

    def _require_repeatable(
        self, t: float, index: int, reads: Array, values: Array, stream: int, result: Array
    ) -> None:
        """Raise BeamdaeError if the law fails or `_next_values` does not return `result` again.

        The same is raised in later runs, whose samples would agree if the memory acts from the
        start.
        """
        repeated = self._next_values(t, index, reads, values, stream)
        if not np.array_equal(repeated, result):
            differs = repeated != result
            sentence = (
                f"the law gave {_format_numbers(result[differs])}, then "
                f"{_format_numbers(repeated[differs])} for the same sample at t = {t:g} s; keep "
                "memory in sample.state, and take noise from sample.random."
            )
            with contextlib.suppress(TypeError):  # Some callable objects have no weak references.
                _laws_with_memory[self.law] = sentence
            raise BeamdaeError(f"{self.name}: {sentence}")
        with contextlib.suppress(TypeError):
            if sentence := _laws_with_memory.get(self.law, ""):
                raise BeamdaeError(f"{self.name}: in an earlier run, {sentence}")


def _format_numbers(numbers: Array) -> str:
    return ", ".join(f"{x:.6g}" for x in numbers)


def _as_finite_numbers(name: str, values: Any) -> list[float] | None:
    """Return the numbers of a list, tuple or array; None for other values.

    The limit of `require_finite` applies: with a force of 1e308 N, runs do not end.
    """
    if not isinstance(values, (list, tuple, np.ndarray)):
        return None
    try:
        # Numbers of lists are checked three times as fast as those of arrays.
        numbers = values.tolist() if isinstance(values, np.ndarray) else values
        return [
            # Most numbers; the other check takes ten times as long.
            float(x)
            if type(x) in _FLOATS and -MAX_MAGNITUDE <= x <= MAX_MAGNITUDE
            else require_finite(name, "value", x)
            for x in numbers
        ]
    except Exception:
        # The methods of a user's list may fail, too.
        return None


def _is_readable(value: Any) -> bool:
    return isinstance(value, (Value, Quantity, Attachment))
