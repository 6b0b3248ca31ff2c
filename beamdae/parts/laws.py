"""Laws of time: smooth pieces between known breakpoints."""

from __future__ import annotations

import warnings
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    as_real,
    format_exception,
    require_finite,
    require_pair,
    require_positive,
    require_sequence,
    set_fields,
    short_repr,
)
from beamdae.symbolic.formulas import Formula
from beamdae.symbolic.statements import SX

# Operations by which a formula can jump or kink where no integrator would stop.
_NONSMOOTH_OPERATIONS = {
    getattr(ca, f"OP_{name}"): name.lower()
    for name in (
        "LT",
        "LE",
        "EQ",
        "NE",
        "IF_ELSE_ZERO",
        "FLOOR",
        "CEIL",
        "FMOD",
        "FABS",
        "SIGN",
        "COPYSIGN",
        "FMIN",
        "FMAX",
    )
}


def require_smooth(part: str, piece: Callable[[Any], Any], function: ca.Function) -> None:
    """Refuse a piece that jumps or kinks where no integrator would stop."""
    used = {function.instruction_id(i) for i in range(function.n_instructions())}
    rough = [name for operation, name in _NONSMOOTH_OPERATIONS.items() if operation in used]
    if rough:
        raise BeamdaeError(
            f"{part}: {describe_law(piece)} must be smooth, but it uses {', '.join(rough)}; "
            "give its pieces to bd.piecewise, so that no step runs over a jump or kink."
        )


_BRANCHES_ON_TIME = (
    "but it decides by the value of t (if, while, and, or, min, max); give its pieces to "
    "bd.piecewise((end time, law), ..., last law)"
)
_NEEDS_NUMBER = (
    "but it needs t as a number, as float, int, random numbers and the functions of math do; use "
    "numpy functions such as np.sin, and bd.table for tables"
)


def describe_law(piece: Callable[[Any], Any]) -> str:
    """'the law', with the name of its function if that has one."""
    name = getattr(piece, "__name__", "<lambda>")
    return "the law" if "<" in name else f"the law {name}"


def evaluate_piece(piece: Callable[[Any], Any], t: SX) -> Any:
    """What a piece makes of the symbol t, as an expression if it is a number or expression."""
    with warnings.catch_warnings():
        # CasADi 3.8 announces a change of numpy functions on its symbols; np.sin(t) and its
        # like give the same scalar expression before and after it.
        warnings.simplefilter("ignore", FutureWarning)
        value = piece(t)
    found = as_real(value)
    if found is not None:
        return SX(found)
    if getattr(value, "ndim", None) == 0:
        value = value.item()
    return SX(value) if isinstance(value, (SX, ca.DM)) else value


def _evaluate_number(piece: Callable[[Any], Any], t: float) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return piece(t)


def _require_time_formula(part: str, piece: Callable[[Any], Any], t: SX, start: float) -> None:
    """Refuse a piece that does not make one expression of the symbol t."""
    wanted = f"{part}: {describe_law(piece)} must be a formula in t"
    try:
        value = evaluate_piece(piece, t)
    except Exception as problem:
        try:
            _evaluate_number(piece, start)
        except Exception as own:
            raise BeamdaeError(
                f"{wanted} that gives a number, but it failed at t = {start:g}, {format_exception(own)}."
            ) from own
        # Of bool() on a symbol; nothing else tells it from other failures.
        decides = "truth value" in str(problem)
        raise BeamdaeError(
            f"{wanted}, {_BRANCHES_ON_TIME if decides else _NEEDS_NUMBER}."
        ) from None
    if not isinstance(value, SX) or value.shape != (1, 1):
        raise BeamdaeError(
            f"{part}: {describe_law(piece)} must return one number, got {short_repr(value)}."
        )
    strange = [x.name() for x in ca.symvar(value) if x.element_hash() != t.element_hash()]
    if strange:
        raise BeamdaeError(
            f"{part}: {describe_law(piece)} must depend on t alone, not on {', '.join(strange[:3])}."
        )


# Times [s] after the start at which a law is asked for numbers.
_SAMPLE_TIMES = (0.0, 0.37, 1.9, 11.3)


def require_numeric_agreement(
    part: str, piece: Callable[[Any], Any], function: ca.Function, start: float
) -> None:
    """Refuse a formula that loses what the function does: float(t) is nan of a symbol."""
    times = start + np.array(_SAMPLE_TIMES)
    try:
        by_number = np.array([as_real(_evaluate_number(piece, t)) for t in times.tolist()], float)
    except Exception:
        # It takes symbols alone, or no time so late.
        return
    known = np.isfinite(by_number)
    by_formula = np.array([float(function([t, t])) for t in times[known]])
    size = np.max(np.abs(by_number[known]), initial=0.0)
    # What is not a number is not near.
    if not np.all(np.abs(by_formula - by_number[known]) <= 1e-6 * size):
        raise BeamdaeError(
            f"{part}: {describe_law(piece)} must be a formula in t, {_NEEDS_NUMBER}."
        )


@dataclass(frozen=True)
class Law:
    """A function of time with breakpoints.

    Attributes
    ----------
    pieces
        Functions of t, smooth each, valid between neighboring breakpoints.
    breakpoints
        Ascending times [s] at which one piece hands over to the next; integrators stop and restart
        there.
    time_scale
        Shortest time [s] over which the law changes, or None: an adaptive integrator keeps its
        steps below it.
    """

    pieces: tuple[Callable[[Any], Any], ...]
    breakpoints: tuple[float, ...] = ()
    time_scale: float | None = None

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
                f"Law: {len(self.pieces)} pieces need {len(self.pieces) - 1} breakpoints, "
                f"got {len(self.breakpoints)}."
            )
        if any(b <= a for a, b in pairwise(self.breakpoints)):
            raise BeamdaeError(f"Law: breakpoints must ascend, got {self.breakpoints}.")
        if self.time_scale is not None:
            set_fields(self, time_scale=require_positive("Law", "time_scale", self.time_scale))

    def __call__(self, time: SX) -> SX:
        """The law at time[0], on the branch that time[1] lies in."""
        return _select_branch(self.pieces, self.breakpoints, time)

    @property
    def formula(self) -> Callable[[SX], SX]:
        """The law as a `Formula`, if its pieces are such; otherwise the law itself."""
        # A class of the user's own may make something else of the pieces.
        if type(self) is not Law or not all(isinstance(piece, Formula) for piece in self.pieces):
            return self
        pieces: Any = self.pieces
        kind = _Pieces(tuple(x.kind for x in pieces), tuple(len(x.numbers) for x in pieces))
        own = (number for piece in pieces for number in piece.numbers)
        return Formula(kind, (*self.breakpoints, *own))

    def at(self, t: float) -> float:
        """The law at a time [s], of a law whose pieces take numbers."""
        return float(self.pieces[bisect_right(self.breakpoints, t)](t))


def _select_branch(pieces: Sequence[Callable[[Any], Any]], breakpoints: Any, time: SX) -> SX:
    """What the pieces give at time[0], on the branch that time[1] lies in."""
    value = evaluate_piece(pieces[-1], time[0])
    for k in range(len(pieces) - 2, -1, -1):
        value = ca.if_else(time[1] < breakpoints[k], evaluate_piece(pieces[k], time[0]), value)
    return value


@dataclass(frozen=True)
class _Pieces:
    """The kind of laws whose pieces are of these kinds; the breakpoints are the first numbers."""

    kinds: tuple[Callable[..., Any], ...]
    counts: tuple[int, ...]

    def __call__(self, time: SX, numbers: Any) -> SX:
        first, pieces = len(self.kinds) - 1, []
        for kind, count in zip(self.kinds, self.counts, strict=True):
            pieces.append(Formula(kind, numbers[first : first + count]))
            first += count
        return _select_branch(pieces, numbers, time)


@dataclass(frozen=True)
class _ShiftedPiece:
    """A kind that begins at a time, the first of its numbers."""

    kind: Callable[..., Any]

    def __call__(self, t: Any, numbers: Any) -> Any:
        return self.kind(t - numbers[0], numbers[1:])


def shift_law(law: Law, since: float) -> Law:
    """A law of the time since `since` [s]."""

    def moved(piece: Callable[[Any], Any]) -> Callable[[Any], Any]:
        if isinstance(piece, Formula):
            return Formula(_ShiftedPiece(piece.kind), (since, *piece.numbers))
        return lambda t: piece(t - since)

    pieces = tuple(moved(piece) for piece in law.pieces)
    return Law(pieces, tuple(since + b for b in law.breakpoints), law.time_scale)


def as_law(part: str, value: Any, start: float = 0.0) -> Law:
    """Turn a number or any function of t into a law, or say what is wrong with it.

    `start` is the first time [s] it will be asked for.
    """
    if isinstance(value, Law):
        law = value
    elif callable(value):
        law = Law((value,))
    else:
        number = require_finite(part, "law", value)
        law = Law((Formula(_constant, (number,)),))
    if isinstance(law.formula, Formula):
        first = law.at(start)
    else:
        function = _law_function(part, law, start)
        if law is not value:
            require_numeric_agreement(part, value, function, start)
            require_smooth(part, value, function)
        first = float(function([start, start]))
    if not np.isfinite(first):
        raise BeamdaeError(
            f"{part}: {describe_law(law.pieces[0])} must be finite, at t = {start:g} it is {first}."
        )
    require_finite(part, f"{describe_law(law.pieces[0])} at t = {start:g}", first)
    return law


def _law_function(part: str, law: Law, start: float) -> ca.Function:
    """The law as a function of (t, branch)."""
    time = SX.sym("t", 2)
    for piece in law.pieces:
        _require_time_formula(part, piece, time[0], start)
    return ca.Function("law", [time], [law(time)])


def sine(amplitude: float, frequency: float, phase: float = 0.0) -> Law:
    """Law amplitude * sin(2 pi frequency t + phase); frequency in Hz, phase in rad."""
    amplitude = require_finite("sine", "amplitude", amplitude)
    frequency = require_positive("sine", "frequency", frequency)
    phase = require_finite("sine", "phase", phase)
    omega = 2.0 * np.pi * frequency
    return Law((Formula(_sine, (amplitude, omega, phase)),), (), 1.0 / frequency)


def _constant(t: Any, numbers: Any) -> Any:
    return numbers[0]


def _sine(t: Any, numbers: Any) -> Any:
    return numbers[0] * np.sin(numbers[1] * t + numbers[2])


def _accelerating_angle(t: Any, numbers: Any) -> Any:
    return numbers[0] * (0.5 * t**2 + (np.cos(numbers[1] * t) - 1.0) / numbers[1] ** 2)


def _steady_angle(t: Any, numbers: Any) -> Any:
    return numbers[0] * (t - numbers[1])


def run_up(speed: float, duration: float) -> Law:
    """Angle of a smooth run-up to a constant angular speed.

    Eq. (28) of the paper:
    speed / duration * (t^2/2 + (duration/2 pi)^2 (cos(2 pi t/duration) - 1)) up to t = duration,
    then speed * (t - duration/2); speed in rad/s, duration in s.
    """
    speed = require_finite("run_up", "speed", speed)
    duration = require_positive("run_up", "duration", duration)
    omega = 2.0 * np.pi / duration
    rising = Formula(_accelerating_angle, (speed / duration, omega))
    risen = Formula(_steady_angle, (speed, 0.5 * duration))
    return Law((rising, risen), (duration,), duration)


def piecewise(*pieces: Any) -> Law:
    """Laws one after the other: (end time, law), (end time, law), ..., last law.

    `piecewise((1.0, 5.0), 0.0)` is 5 until t = 1 s and 0 from then on. Every law sees the same t.
    """
    if not pieces:
        raise BeamdaeError("piecewise: give at least one law.")
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
        raise BeamdaeError(f"piecewise: end times must ascend, got {ends}.")
    if any(law.breakpoints for law in laws):
        raise BeamdaeError("piecewise: a piece must be smooth, it must not be piecewise itself.")
    scales = [law.time_scale for law in laws if law.time_scale is not None]
    scale = min(scales) if scales else None
    return Law(tuple(law.pieces[0] for law in laws), tuple(ends), scale)


def _require_numbers(name: str, values: Any) -> np.ndarray:
    given = require_sequence("table", name, values, "a list of numbers")
    return np.array([require_finite("table", name, value) for value in given])


def table(times: Any, values: Any) -> Law:
    """Natural cubic spline through a table, constant outside it."""
    t, y = _require_numbers("times", times), _require_numbers("values", values)
    if t.shape != y.shape or len(t) < 3:
        raise BeamdaeError(
            "table: times and values must be lists of the same length, at least 3, got "
            f"{len(t)} and {len(y)}."
        )
    shortest = float(np.min(np.diff(t)))
    if shortest <= 0.0:
        raise BeamdaeError("table: times must ascend.")
    require_positive("table", "the shortest stretch between its times", shortest)
    # Here, for it takes as long to import as a short run, and few models have tables.
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(t, y, bc_type="natural")
    inner = [float(x) for x in t[1:-1]]

    def inside(at: Any) -> Any:
        start = ca.pw_const(at, inner, t[:-1])
        return sum(ca.pw_const(at, inner, spline.c[k]) * (at - start) ** (3 - k) for k in range(4))

    first, last = float(y[0]), float(y[-1])
    return Law(
        (lambda at: first, inside, lambda at: last),
        (float(t[0]), float(t[-1])),
        4.0 * shortest,
    )
