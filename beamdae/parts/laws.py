"""Time laws: smooth pieces between breakpoints, and checks of user functions."""

from __future__ import annotations

import math
import warnings
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    as_real,
    convert_fields,
    format_exception,
    optional,
    require_finite,
    require_pair,
    require_positive,
    require_sequence,
    set_fields,
    short_repr,
    warn_of_degrees,
)
from beamdae.native.instructions import by_operation, read_operations
from beamdae.parts.forces.formula_checks import JUMP_OPERATIONS
from beamdae.parts.tables import Table, locked_pieces
from beamdae.symbolic.formula import Formula, FormulaExpression, constant_formula
from beamdae.symbolic.signals import (
    FormulaError,
    Signal,
    as_expression,
    as_scalar,
    find_other_symbols,
    with_references,
)
from beamdae.symbolic.statements import SX
from beamdae.symbolic.table_lookups import record_calls

# Operations with jumps or kinks, at which an integrator would not stop.
_NONSMOOTH_OPERATIONS = JUMP_OPERATIONS | by_operation(
    FABS="np.abs", COPYSIGN="np.copysign", FMIN="np.minimum", FMAX="np.maximum"
)
# Times after the start [s] at which the expression of a law is compared with its function.
_SAMPLE_TIMES = (0.0, 0.37, 1.9, 11.3)
# Largest difference at these times, relative to the largest value.
_SAMPLE_TOLERANCE = 1e-6
# Adaptive integrators take at least this many steps per time scale of a law. In a table, no step is
# longer than the shortest interval.
MIN_STEPS_PER_TIME_SCALE = 4.0
_FORMULAS_ONLY = (
    "without branches on t (if, while, and, or, &, min, max), float, int, random numbers or "
    "functions of math; use numpy functions such as np.sin, bd.table for tables, and "
    "bd.piecewise((end time, law), ..., last law) for pieces"
)


class TableRange(NamedTuple):
    """Argument rate t + offset of a table with outside="error" in a time law.

    Attributes
    ----------
    table, axis
        The table, and the index of its argument.
    rate, offset
        Rate [1/s] and value at t = 0 of the argument.
    since, until
        Times [s] between which the law contains the table.
    """

    table: Table
    axis: int
    rate: float
    offset: float
    since: float = -math.inf
    until: float = math.inf

    def reason_to_stop(self, t: float, branch: float) -> str | None:
        """Return the reason why a run must end at t [s] if the table ends there, or None.

        `branch` is a time inside the interval after t.
        """
        knots, value = self.table.axes[self.axis], self.rate * branch + self.offset
        if not self.since < branch < self.until or knots[0] <= value <= knots[-1]:
            return None
        return str(self.table.describe_argument(self.axis, self.rate * t + self.offset))


@dataclass(frozen=True)
class Law:
    """Piecewise smooth function of time; laws can be added to laws, numbers and functions of t.

    Attributes
    ----------
    pieces
        Smooth functions of t [s], one for each interval: before the first breakpoint, between
        successive breakpoints and after the last; without breakpoints, a single function.
    breakpoints
        Ascending times [s] between the pieces; integrators stop and restart there.
    time_scale
        Shortest time [s] over which the law changes, or None (no limit). Steps of adaptive
        integrators are at most a quarter of this time.
    ranges
        Ranges of tables that end a run where they end.

    Raises
    ------
    BeamdaeError
        If `pieces` is not a tuple of functions, the number of breakpoints is not one less than the
        number of pieces, the breakpoints are not finite or do not ascend, or `time_scale` is not
        positive.
    """

    pieces: tuple[Callable[[Any], Any], ...]
    breakpoints: tuple[float, ...] = ()
    time_scale: float | None = None
    ranges: tuple[TableRange, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.pieces, tuple) or not all(callable(p) for p in self.pieces):
            raise BeamdaeError(
                f"Law: pieces must be a tuple of functions, got {short_repr(self.pieces)}."
            )
        times = require_sequence("Law", "breakpoints", self.breakpoints, "a list of times")
        set_fields(
            self, breakpoints=tuple(require_finite("Law", "breakpoints", time) for time in times)
        )
        if len(self.pieces) != len(self.breakpoints) + 1:
            raise BeamdaeError(
                f"Law: {len(self.pieces)} pieces require {len(self.pieces) - 1} "
                f"breakpoints, got {len(self.breakpoints)}."
            )
        if any(b <= a for a, b in pairwise(self.breakpoints)):
            raise BeamdaeError(f"Law: breakpoints must ascend, got {self.breakpoints} s.")
        convert_fields(self, time_scale=optional(require_positive))
        ranges = self.ranges
        if not isinstance(ranges, tuple) or not all(isinstance(x, TableRange) for x in ranges):
            raise BeamdaeError(
                f"Law: ranges must be a tuple of ranges of tables, got {short_repr(ranges)}; "
                "omit the argument."
            )

    def __call__(self, time: SX) -> SX:
        """Return the value at time[0] of the piece that is valid at time[1]."""
        if not isinstance(time, SX) or time.numel() != 2:
            raise BeamdaeError(
                f"Law: a law cannot be called like a function, got {short_repr(time)}; use "
                "law.at(t) for its value at a number t [s], and pass the law itself to parts."
            )
        return _select_piece(self.pieces, self.breakpoints, time)

    def __add__(self, other: Any) -> Law:
        """Return the sum with another law: a number, a function of t or a `Law`."""
        laws = self, as_law("Law", other)
        breakpoints = sorted({time for law in laws for time in law.breakpoints})
        pairs = [tuple(x._piece_at(t) for x in laws) for t in (-math.inf, *breakpoints)]
        # Equal pairs have one sum, so that the pieces of tables remain one function.
        sums = {_identify(*pair): _add_pieces(*pair) for pair in pairs}
        pieces = tuple(sums[_identify(*pair)] for pair in pairs)
        scales = [law.time_scale for law in laws if law.time_scale is not None]
        ranges = self.ranges + laws[1].ranges
        return Law(pieces, tuple(breakpoints), min(scales, default=None), ranges)

    __radd__ = __add__

    def _piece_at(self, t: float) -> Callable[[Any], Any]:
        return self.pieces[bisect_right(self.breakpoints, t)]

    @property
    def formula(self) -> Callable[[SX], SX]:
        """A plain `Law` as a `Formula` if all its pieces are formulas, otherwise the law itself."""
        # A subclass may evaluate its pieces in another way.
        if type(self) is not Law or not all(isinstance(piece, Formula) for piece in self.pieces):
            return self
        return _combine(_select_formula, constant_formula(*self.breakpoints), *self.pieces)

    def at(self, t: float) -> float:
        """Return the value at time `t` [s].

        Raises
        ------
        BeamdaeError
            If `t` is not a finite number, or the call of the piece fails or does not return a
            number.
        """
        t = require_finite("Law.at", "t", t)
        try:
            return _evaluate_at(self._piece_at(t), t)
        except Exception as problem:
            raise BeamdaeError(
                f"Law.at: the law at t = {t:g} s must be a number, but the call failed: "
                f"{format_exception(problem)}."
            ) from problem


def _select_piece(pieces: Sequence[Callable[[Any], Any]], breakpoints: Any, time: SX) -> SX:
    t, branch = time[0], time[1]
    value = _evaluate_locked(pieces[-1], t, branch)
    for k in range(len(pieces) - 2, -1, -1):
        # One expression for all pieces of a table, however many rows it has.
        if pieces[k] is not pieces[k + 1]:
            piece = _evaluate_locked(pieces[k], t, branch)
            value = ca.if_else(branch < breakpoints[k], piece, value)
    return value


def _evaluate_locked(piece: Callable[[Any], Any], t: SX, branch: SX) -> Any:
    """Return the value of a piece at t; its tables are continued smoothly from t = `branch`."""
    if isinstance(piece, Formula):
        return _evaluate_piece(piece, t)
    symbol = SX.sym("t")
    with locked_pieces(symbol, branch):
        value = _evaluate_piece(piece, symbol)
    return ca.substitute(value, symbol, t) if isinstance(value, SX) else value


def _evaluate_piece(piece: Callable[[Any], Any], t: SX) -> Any:
    """Return the value of a piece at the symbol t; numbers and expressions become SX."""
    value = as_expression(piece(as_scalar(t)))
    number = as_real(value)
    if number is not None:
        return SX(number)
    if getattr(value, "ndim", None) == 0:
        value = value.item()
    return SX(value) if isinstance(value, (SX, ca.DM)) else value


def _evaluate_at(piece: Callable[[Any], Any], t: float) -> float:
    """Return the value of a piece at the number t, also if the piece accepts only expressions."""
    try:
        value = with_references(as_expression(piece(t)))
        # float() of an expression that looks up a table is nan.
        return float(ca.evalf(value) if isinstance(value, SX) else value)
    except Exception as problem:
        # Some functions of CasADi, such as the steps of a `table`, accept symbols only.
        try:
            return float(ca.evalf(with_references(_evaluate_piece(piece, SX(t)))))
        except Exception:
            raise problem from None


def _combine(build: Callable[..., Any], *functions: Callable[..., Any]) -> Formula:
    """Return the formula `build(t, *functions)` of formulas."""
    expression, numbers = FormulaExpression.of(build, functions)
    return Formula(expression, tuple(numbers.tolist()))


def _select_formula(time: SX, breakpoints: Formula, *pieces: Formula) -> SX:
    return _select_piece(pieces, breakpoints(), time)


def _add_formulas(t: Any, first: Formula, second: Formula) -> Any:
    return first(t) + second(t)


def _shift_formula(t: Any, since: Formula, law: Formula) -> Any:
    return law(t - since()[0])


def _add_pieces(first: Callable[[Any], Any], second: Callable[[Any], Any]) -> Callable[[Any], Any]:
    if isinstance(first, Formula) and isinstance(second, Formula):
        return _combine(_add_formulas, first, second)
    return lambda t: first(t) + second(t)


def _identify(*pieces: Any) -> tuple[int, ...]:
    """Return a key of pieces, which may be objects without a hash."""
    return tuple(map(id, pieces))


def shift_law(law: Law, since: float) -> Law:
    """Return the law whose value at t is the value of `law` at t - `since` [s]."""

    def shift_piece(piece: Callable[[Any], Any]) -> Callable[[Any], Any]:
        if isinstance(piece, Formula):
            return _combine(_shift_formula, constant_formula(since), piece)
        return lambda t: piece(t - since)

    shifted = {_identify(piece): shift_piece(piece) for piece in law.pieces}
    pieces = tuple(shifted[_identify(piece)] for piece in law.pieces)
    ranges = tuple(
        x._replace(offset=x.offset - x.rate * since, since=x.since + since, until=x.until + since)
        for x in law.ranges
    )
    return Law(pieces, tuple(since + b for b in law.breakpoints), law.time_scale, ranges)


def as_law(part: str, value: Any, start: float = 0.0) -> Law:
    """Return a number, a function of t, a signal or a `Law` as a checked `Law`.

    Parameters
    ----------
    part
        Name of the part, for messages.
    value
        A number, a function of t [s], a `Law`, or an input, state, sensor or expression of them.
    start
        First time [s] at which the law is evaluated.

    Raises
    ------
    BeamdaeError
        If a number is not finite, a function or a piece of a `Law` is not a formula in t, a
        function is not smooth, or the value at `start` is not finite or exceeds 1e75 in magnitude.
    """
    if isinstance(value, Law):
        law = value
    elif isinstance(value, Table):
        if len(value.axes) > 1:
            raise BeamdaeError(
                f"{part}: {value.name} has two arguments and is no time law; use it in a formula, "
                "such as lambda t: table(t, 2.0)."
            )
        value = law = _split_at_tables(part, value)
    elif isinstance(value, (Signal, SX)):
        law = Law((_constant_expression(SX(as_expression(value))),))
    elif callable(value):
        law = _split_at_tables(part, value)
    else:
        number = require_finite(part, "law", value)
        law = Law((Formula(_constant, (number,)),))
    if isinstance(law.formula, Formula):
        initial_value = law.at(start)
    else:
        time = SX.sym("t", 2)
        for piece in {_identify(x): x for x in law.pieces}.values():
            _require_formula_in_time(part, piece, time[0], start)
        function = ca.Function("law", [time], [with_references(law(time))])
        if law is not value:
            _require_numeric_agreement(part, value, function, start)
            if len(law.pieces) == 1:
                _require_smooth(part, value, function)
        initial_value = float(function([start, start]))
    if not np.isfinite(initial_value):
        raise BeamdaeError(
            f"{part}: {_law_label(law.pieces[0])} must be finite, got {initial_value} "
            f"at t = {start:g} s."
        )
    require_finite(part, f"{_law_label(law.pieces[0])} at t = {start:g} s", initial_value)
    return law


def _split_at_tables(part: str, function: Callable[[Any], Any]) -> Law:
    """Return a function of t as a law with smooth pieces.

    The breakpoints are the times at which the argument of a table in it passes an end of the table,
    or a row at which its value or slope jumps.
    """
    t = SX.sym("t")
    with record_calls(as_symbols=True) as calls:
        try:
            value = _evaluate_piece(function, t)
        except Exception:
            # The checks of the law raise the error with its cause.
            calls.clear()
    if not calls:
        return Law((function,))
    symbols = [t, *(call.value for call in calls)]
    if isinstance(value, SX):
        _require_smooth(part, function, ca.Function("law", symbols, [with_references(value)]))
    times: set[float] = set()
    time_scales: list[float] = []
    ranges: list[TableRange] = []
    for table, arguments, _ in calls:
        for axis, (knots, argument) in enumerate(zip(table.axes, arguments, strict=True)):
            rate, offset = _as_line(part, table, argument, t)
            if rate == 0.0:
                continue
            if table.is_repeated and not table.is_smooth:
                raise BeamdaeError(
                    f"{part}: {table.name} is repeated and linear, so that a law of time would "
                    "have breakpoints in each period; use kind='pchip', or repeat the rows of one "
                    "period for the whole run."
                )
            times.update(((table.kinks(axis) - offset) / rate).tolist())
            row_times = sorted(((knots - offset) / rate).tolist())
            if table.is_smooth:
                shortest = float(np.min(np.diff(row_times)))
                time_scales.append(MIN_STEPS_PER_TIME_SCALE * shortest)
            if table.outside == "error":
                times.update(row_times[:: len(row_times) - 1])
                ranges.append(TableRange(table, axis, rate, offset))
    pieces = (function,) * (len(times) + 1)
    return Law(pieces, tuple(sorted(times)), min(time_scales, default=None), tuple(ranges))


def _constant_expression(value: SX) -> Callable[[Any], SX]:
    return lambda t: value


def _constant(t: Any, numbers: Any) -> Any:
    return numbers[0]


def _sine(t: Any, numbers: Any) -> Any:
    return numbers[0] * np.sin(numbers[1] * t + numbers[2])


def sine(amplitude: float, frequency: float, phase: float = 0.0) -> Law:
    """Return the law amplitude * sin(2 pi frequency t + phase).

    Parameters
    ----------
    amplitude
        Amplitude, in the unit of the driven quantity.
    frequency
        Frequency [Hz].
    phase
        Phase [rad].

    Returns
    -------
    Law
        The law, with one period as `time_scale`.

    Raises
    ------
    BeamdaeError
        If an argument is not a finite number, or the frequency is not positive.

    Warns
    -----
    BeamdaeWarning
        If the phase is more than a full turn and a usual number of degrees.
    """
    amplitude = require_finite("sine", "amplitude", amplitude)
    frequency = require_positive("sine", "frequency", frequency)
    phase = require_finite("sine", "phase", phase)
    warn_of_degrees("sine", "phase", phase)
    omega = 2.0 * np.pi * frequency
    return Law((Formula(_sine, (amplitude, omega, phase)),), (), 1.0 / frequency)


def half_sine(peak: float, duration: float, start: float = 0.0) -> Law:
    """Return the law of a half-sine pulse peak * sin(pi (t - start) / duration), as of shock tests.

    The law is zero before and after the pulse (IEC 60068-2-27). Laws add up: the gravity
    `-9.81 + bd.half_sine(-peak, duration)` is that of a base with an upward shock, in its axes.

    Parameters
    ----------
    peak
        Peak, in the unit of the driven quantity.
    duration
        Duration of the pulse [s].
    start
        Start of the pulse [s].

    Returns
    -------
    Law
        The law, with breakpoints at both ends of the pulse.

    Raises
    ------
    BeamdaeError
        If an argument is not a finite number, or the duration is not positive.

    Examples
    --------
    >>> import beamdae as bd
    >>> shock = bd.half_sine(30 * 9.81, 0.011)
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81 + bd.half_sine(-30 * 9.81, 0.011)))
    """
    peak = require_finite("half_sine", "peak", peak)
    duration = require_positive("half_sine", "duration", duration)
    start = require_finite("half_sine", "start", start)
    omega = np.pi / duration
    pulse, rest = Formula(_sine, (peak, omega, -omega * start)), Formula(_constant, (0.0,))
    return Law((rest, pulse, rest), (start, start + duration))


def _accelerating_angle(t: Any, numbers: Any) -> Any:
    return numbers[0] * (0.5 * t**2 + (np.cos(numbers[1] * t) - 1.0) / numbers[1] ** 2)


def _steady_angle(t: Any, numbers: Any) -> Any:
    return numbers[0] * (t - numbers[1])


def run_up(speed: float, duration: float) -> Law:
    """Return the law of the angle [rad] for a smooth run-up to a constant angular speed.

    Eq. (28) of Pan & Liu (2012):
    speed / duration * (t^2/2 + (duration/(2 pi))^2 (cos(2 pi t/duration) - 1)) up to t = duration,
    then speed * (t - duration/2).

    Parameters
    ----------
    speed
        Final angular speed [rad/s].
    duration
        Duration of the run-up [s].

    Returns
    -------
    Law
        The law, with a breakpoint at t = `duration`.

    Raises
    ------
    BeamdaeError
        If an argument is not a finite number, or the duration is not positive.
    """
    speed = require_finite("run_up", "speed", speed)
    duration = require_positive("run_up", "duration", duration)
    omega = 2.0 * np.pi / duration
    acceleration = Formula(_accelerating_angle, (speed / duration, omega))
    steady = Formula(_steady_angle, (speed, 0.5 * duration))
    return Law((acceleration, steady), (duration,), duration)


def piecewise(*pieces: Any) -> Law:
    """Return a piecewise law from the arguments (end time, law), ..., last law.

    `piecewise((1.0, 5.0), 0.0)` is 5 until t = 1 s and 0 from then on.

    Parameters
    ----------
    *pieces
        Pairs (end time [s], law), followed by the last law. A law is a number, a function of t or a
        `Law`, such as a `table`; t is the same time for all pieces.

    Returns
    -------
    Law
        The law, with breakpoints at the end times and wherever a law has one within its interval.

    Raises
    ------
    BeamdaeError
        If there are no pieces, a piece but the last is not a pair, the end times are not finite or
        do not ascend, or a law is invalid.
    """
    if not pieces:
        raise BeamdaeError("piecewise: there are no pieces; give at least one law.")
    ends: list[float] = []
    laws: list[Law] = []
    for entry in pieces[:-1]:
        end, law = require_pair(
            "piecewise", "each piece but the last", entry, "a pair (end time, law)"
        )
        laws.append(as_law("piecewise", law, ends[-1] if ends else 0.0))
        ends.append(require_finite("piecewise", "end time", end))
    laws.append(as_law("piecewise", pieces[-1], ends[-1] if ends else 0.0))
    if any(b <= a for a, b in pairwise(ends)):
        raise BeamdaeError(f"piecewise: end times must ascend, got {ends} s.")
    scales = [law.time_scale for law in laws if law.time_scale is not None]
    functions: list[Callable[[Any], Any]] = []
    breakpoints: list[float] = []
    for law, start, end in zip(laws, [-math.inf, *ends], [*ends, math.inf], strict=True):
        first, last = bisect_right(law.breakpoints, start), bisect_left(law.breakpoints, end)
        functions += law.pieces[first : last + 1]
        breakpoints += [*law.breakpoints[first:last], end]
    ranges = tuple(
        x._replace(since=max(x.since, start), until=min(x.until, end))
        for law, start, end in zip(laws, [-math.inf, *ends], [*ends, math.inf], strict=True)
        for x in law.ranges
    )
    return Law(tuple(functions), tuple(breakpoints[:-1]), min(scales, default=None), ranges)


def _as_line(part: str, table: Table, argument: SX, t: SX) -> tuple[float, float]:
    """Return the numbers (a, b) of an argument a t + b of a table."""
    rate = ca.jacobian(argument, t)
    others = [x for x in ca.symvar(argument) if x.element_hash() != t.element_hash()]
    if ca.depends_on(rate, t) or others:
        raise BeamdaeError(
            f"{part}: in a time law, each argument of {table.name} must be a t + b with numbers a "
            "and b."
        )
    return float(ca.evalf(rate)), float(ca.evalf(ca.substitute(argument, t, 0.0)))


def _law_label(piece: Callable[[Any], Any]) -> str:
    """Return "the law", followed by the name of the function if it has one."""
    name = getattr(piece, "__name__", "<lambda>")
    return "the law" if "<" in name else f"the law {name}"


def _evaluate_number(piece: Callable[[Any], Any], t: float) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return piece(t)


def _require_formula_in_time(part: str, piece: Callable[[Any], Any], t: SX, start: float) -> None:
    """Raise BeamdaeError if a piece does not return one expression of the symbol t."""
    requirement = f"{part}: {_law_label(piece)} must be a formula in t"
    try:
        value = _evaluate_locked(piece, t, t)
    except Exception:
        try:
            _evaluate_number(piece, start)
        except FormulaError as problem:
            raise BeamdaeError(f"{requirement} {problem.rule}.") from None
        except Exception as numeric_error:
            raise BeamdaeError(
                f"{requirement} that returns a number, but the call failed at t = "
                f"{start:g} s: {format_exception(numeric_error)}."
            ) from numeric_error
        raise BeamdaeError(f"{requirement}, {_FORMULAS_ONLY}.") from None
    if not isinstance(value, SX) or value.shape != (1, 1):
        raise BeamdaeError(
            f"{part}: {_law_label(piece)} must return one number, got {short_repr(value)}."
        )
    if others := find_other_symbols(value, [t]):
        raise BeamdaeError(
            f"{part}: {_law_label(piece)} must depend only on t, not on {', '.join(others[:3])}."
        )


def _require_numeric_agreement(
    part: str, piece: Callable[[Any], Any], function: ca.Function, start: float
) -> None:
    """Raise BeamdaeError if the expression of a law differs from the values of its function.

    For example, a function that calls float(t) returns nan for a symbol t.
    """
    times = start + np.array(_SAMPLE_TIMES)
    try:
        expected = np.array([as_real(_evaluate_number(piece, t)) for t in times.tolist()], float)
    except Exception:
        # The function accepts only symbols, or is undefined at a sample time.
        return
    is_finite = np.isfinite(expected)
    values = np.array([float(function([t, t])) for t in times[is_finite]])
    size = np.max(np.abs(expected[is_finite]), initial=0.0)
    # A nan fails this comparison.
    if not np.all(np.abs(values - expected[is_finite]) <= _SAMPLE_TOLERANCE * size):
        raise BeamdaeError(f"{part}: {_law_label(piece)} must be a formula in t, {_FORMULAS_ONLY}.")


def _require_smooth(part: str, piece: Callable[[Any], Any], function: ca.Function) -> None:
    """Raise BeamdaeError if a law has jumps or kinks, at which an integrator would not stop."""
    operations = read_operations(function)
    nonsmooth = [
        name for operation, name in _NONSMOOTH_OPERATIONS.items() if operation in operations
    ]
    if nonsmooth:
        raise BeamdaeError(
            f"{part}: {_law_label(piece)} must be smooth, but uses "
            f"{', '.join(nonsmooth)}; give smooth pieces to bd.piecewise, so that no "
            "step crosses a jump or kink."
        )
