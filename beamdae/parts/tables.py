"""Tables: interpolated functions of one or two arguments, for laws and force formulas."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    InputWarning,
    format_distinct,
    require_choice,
    require_finite,
    require_name,
    require_positive,
    require_sequence,
    short_repr,
    warn_user,
)
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.signals import Signal, as_expression, as_scalar, find_signals
from beamdae.symbolic.statements import SX, Local
from beamdae.symbolic.table_lookups import (
    TableCall,
    find_row,
    is_inside_formula,
    is_inside_time_law,
    pick_numbers,
    record_call,
    uses_symbols_for_numbers,
)

Array = np.ndarray

KINDS = ("previous", "linear", "pchip", "spline")
OUTSIDE = ("hold", "error", "repeat")
_MIN_ROWS = {"previous": 2, "linear": 2, "pchip": 2, "spline": 3}
_DEGREES = {"previous": 0, "linear": 1, "pchip": 3, "spline": 3}
MAX_AXES = 2
# Smaller jumps of the slope, relative to the steepest slope, are rounding errors of rows on a line.
_MIN_SLOPE_JUMP = 1e-12
# Slopes that change the values of both adjacent intervals less, relative to the values at their
# ends, are rounding errors.
_SLOPE_ROUNDING = 1e-14
# Splines that leave the values of two successive rows by more between them, relative to the range
# of all values, are hardly intended. A sine with four rows per period, too few for a spline, leaves
# them by 0.2, one with five by at most 0.1.
_MAX_OVERSHOOT = 0.15
_OVERSHOOT_PLACES = np.arange(1, 32) / 32.0  # between two rows
# Smaller overshoots, relative to the largest value, are rounding errors of constant values.
_MIN_OVERSHOOT = 1e-12
# Difference of the first and the last value of a repeated table, relative to the largest value,
# that is a rounding error.
_MAX_GAP = 1e-9
# Argument t of a time law and the time, a number or symbol, at which tables select one smooth
# piece, or None.
_LOCK: ContextVar[tuple[SX, SX] | None] = ContextVar("_LOCK", default=None)


@contextmanager
def locked_pieces(t: SX, at: SX) -> Iterator[None]:
    """Let tables of the symbol `t` return the smooth piece that is valid at t = `at`."""
    token = _LOCK.set((t, at))
    try:
        yield
    finally:
        _LOCK.reset(token)


class _TableNumbers(Signal):
    """Numbers of a table, which become data of the statements whose formulas contain the table."""

    # No input or state can have this name.
    name = "=table"
    table_call: TableCall | None = None

    def __init__(self, data: list[float]) -> None:
        self._data = data

    @property
    def size(self) -> int:
        """Number of all numbers."""
        return len(self._data)

    @property
    def data(self) -> list[float]:
        """The numbers."""
        return self._data

    reference = data

    def express(self, local: Local) -> SX:
        """Return the numbers in terms of `local`."""
        return local.data


class _Numbers(NamedTuple):
    """Numbers of a table, or symbols in their place.

    Attributes
    ----------
    axes
        Values of each argument.
    corners
        Columns of values and, in cubic tables, of derivatives by the arguments: at the rows of the
        only argument, or at the four corners of each cell of two arguments, side by side.
    limits
        First and last value of each argument.
    values
        Values at the limits of the only argument.
    """

    axes: Sequence[SX]
    corners: Sequence[SX]
    limits: Sequence[SX]
    values: SX


class _Place(NamedTuple):
    """Place on an axis.

    Attributes
    ----------
    row
        Row at the beginning of the interval.
    depth, length
        Distance from this row, and length of the interval.
    """

    row: SX
    depth: SX
    length: SX

    @classmethod
    def find(cls, argument: SX, knots: SX, row: SX) -> _Place:
        """Return the place of an argument in the interval that begins at `row`."""
        first, last = ca.vertsplit(pick_numbers(row, knots, 2))
        return cls(row, argument - first, last - first)

    def interpolate(self, values: SX, slopes: SX | None = None) -> SX:
        """Return the value between both ends of the interval; cubic if `slopes` are given."""
        mean = (values[1] - values[0]) / self.length
        if slopes is None:
            return values[0] + self.depth * mean
        part = self.depth / self.length
        square = 3.0 * mean - 2.0 * slopes[0] - slopes[1]
        cube = slopes[0] + slopes[1] - 2.0 * mean
        return values[0] + self.depth * (slopes[0] + part * (square + part * cube))


@dataclass(frozen=True, eq=False, repr=False)
class Table:
    """Interpolated function of one or two arguments, see `table`.

    Attributes
    ----------
    name
        Name in messages.
    axes
        Ascending values of each argument, a tuple of arrays.
    values
        Values at the points of the grid; the shape is the length of each axis.
    kind, outside
        As in `table`.
    arguments
        Names of the arguments in messages.
    """

    name: str
    axes: tuple[Array, ...]
    values: Array
    kind: str
    outside: str
    arguments: tuple[str, ...]

    def __repr__(self) -> str:
        size = " x ".join(str(len(axis)) for axis in self.axes)
        return f"<table {self.name} of {size} values, {self.kind}>"

    @property
    def is_repeated(self) -> bool:
        """True if the table is periodic."""
        return self.outside == "repeat"

    @property
    def degree(self) -> int:
        """Degree of the polynomials between the rows."""
        return _DEGREES[self.kind]

    @property
    def is_smooth(self) -> bool:
        """True if the slope is continuous at the rows, but for the ends."""
        return self.degree > 1

    def __call__(self, *arguments: Any) -> Any:
        """Return the interpolated value.

        Parameters
        ----------
        *arguments
            One number, array or symbol of a formula per axis, in the units of the table.

        Returns
        -------
        float, ndarray or SX
            The values. Outside the table, they are those at its edge, or of its repetitions;
            symbols may be outside the table even if `outside` is "error", because only the runs
            stop.

        Raises
        ------
        BeamdaeError
            If the number of arguments differs from the number of axes, or an argument is neither a
            number nor an array of numbers nor a symbol; if `outside` is "error", also if a number
            is outside the table, or if the table is evaluated with a symbol that is not a signal
            elsewhere than in a time law or the formula of a force.
        """
        if len(arguments) != len(self.axes):
            raise BeamdaeError(
                f"{self.name}: the table has {len(self.axes)} argument"
                f"{'s' if len(self.axes) > 1 else ''} ({', '.join(self.arguments)}), got "
                f"{len(arguments)}."
            )
        values = [as_expression(x) for x in arguments]
        if any(isinstance(x, (ca.SX, ca.DM)) for x in values):
            return as_scalar(self._express(tuple(SX(x) for x in values)))
        try:
            arrays = [np.asarray(x) for x in values]
            if any(x.dtype == object for x in arrays):
                return np.vectorize(self.__call__, otypes=[object])(*arrays)[()]
            result = self._evaluate([np.asarray(x, float) for x in arrays])
        except (TypeError, ValueError) as problem:
            if isinstance(problem, BeamdaeError):
                raise
            raise BeamdaeError(
                f"{self.name}: arguments must be numbers, arrays or symbols of a formula, got "
                f"{', '.join(map(short_repr, arguments))}."
            ) from None
        return float(result) if result.ndim == 0 else result

    def at(self, *arguments: float) -> float:
        """Return the value at numbers; see `__call__`."""
        numbers = [require_finite(self.name, "argument", x) for x in arguments]
        return float(self(*numbers))

    def _evaluate(self, arguments: list[Array]) -> Array:
        if self.outside == "error":
            for axis, (x, knots) in enumerate(zip(arguments, self.axes, strict=True)):
                is_outside = (x < knots[0]) | (x > knots[-1])
                if np.any(is_outside):
                    first = float(x[is_outside].flat[0])
                    raise BeamdaeError(
                        f"{self.name}: {self.describe_argument(axis, first)}; extend the table or "
                        "pass outside='hold'."
                    )
        rows = np.broadcast_arrays(*arguments)
        values = self._function(np.stack([x.ravel() for x in rows], axis=-1))
        return values.reshape(rows[0].shape)

    @cached_property
    def _function(self) -> RowFunction:
        """Function of rows of arguments."""
        x, numbers = SX.sym("x", len(self.axes)), self._split_numbers(SX(self._signal.data))
        t = SX.sym("t")
        value = self._express_piece(numbers, tuple(ca.vertsplit(x)), t, t)
        return RowFunction(ca.Function("table", [x], [value]))

    def _express(self, arguments: tuple[SX, ...]) -> SX:
        lock = _LOCK.get()
        if lock is not None:
            return self._express_piece(self._numbers, arguments, *lock)
        if not self.degree and not is_inside_time_law():
            raise BeamdaeError(
                f"{self.name}: kind='previous' jumps at the rows, where integrators stop only in "
                "time laws; use kind='linear' or 'pchip' in other formulas."
            )
        if not is_inside_formula() and (signals := find_signals(*arguments)):
            # The formula of the value is known only to its numbers: a signal of this call.
            numbers = _TableNumbers(self._signal.data)
            value = self._express_value(self._split_numbers(numbers.value_symbol), arguments)
            numbers.table_call = TableCall(self, arguments, value)
            signals[0].keep(numbers)
            return value
        return record_call(self, arguments, self._express_value(self._numbers, arguments))

    def _express_value(self, x: _Numbers, arguments: tuple[SX, ...]) -> SX:
        if self.is_repeated:
            inside = self._wrap(x, arguments)
        else:
            # Outside the table, the value at its edge.
            inside = tuple(
                ca.fmin(ca.fmax(argument, limits[0]), limits[1])
                for argument, limits in zip(arguments, x.limits, strict=True)
            )
        places = [_Place.find(*pair, find_row(*pair)) for pair in zip(inside, x.axes, strict=True)]
        return self._interpolate(x, places)

    def _wrap(self, x: _Numbers, arguments: tuple[SX, ...]) -> tuple[SX, ...]:
        """Return the argument of a repeated table, reduced to its range."""
        first, last = ca.vertsplit(x.limits[0])
        center = 0.5 * (first + last)
        return (center + ca.remainder(arguments[0] - center, last - first),)

    @property
    def _numbers(self) -> _Numbers:
        """Numbers of the table, or symbols in their place."""
        uses_symbols = uses_symbols_for_numbers()
        return self._split_numbers(
            self._signal.value_symbol if uses_symbols else SX(self._signal.data)
        )

    def _split_numbers(self, data: SX) -> _Numbers:
        n, corners = len(self.axes), self._corners
        sizes = [*map(len, self.axes), *map(len, corners), *[2] * (n + 1)]
        columns = ca.vertsplit(data, np.cumsum([0, *sizes]).tolist())
        end = n + len(corners)
        return _Numbers(columns[:n], columns[n:end], columns[end:-1], columns[-1])

    @cached_property
    def _signal(self) -> _TableNumbers:
        # Limits are separate numbers, so that derivatives with respect to an axis are lookups.
        limits = [axis[[0, -1]] for axis in self.axes]
        columns = [*self.axes, *self._corners, *limits, self.values.flat[[0, -1]]]
        return _TableNumbers(np.concatenate(columns).tolist())

    @cached_property
    def _corners(self) -> list[Array]:
        """Numbers of `_Numbers.corners`; values and slopes have small rounding errors."""
        arrays = [self.values]
        rounding = [_SLOPE_ROUNDING * np.abs(self.values)]
        if self.is_smooth:
            for axis, knots in enumerate(self.axes):
                slopes = [
                    _differentiate_axis(knots, x, axis, self.kind, self.is_repeated) for x in arrays
                ]
                bounds = [_bound_slopes(knots, x, axis) for x in rounding]
                # Rounding errors would hide how slopes depend on parameters of a model.
                arrays += [
                    np.where(np.abs(x) > bound, x, 0.0)
                    for x, bound in zip(slopes, bounds, strict=True)
                ]
                rounding += bounds
        if len(self.axes) == 1:
            return arrays
        corners = [
            (slice(i, i - 1 or None), slice(j, j - 1 or None)) for i in (0, 1) for j in (0, 1)
        ]
        return [np.stack([x[corner] for corner in corners], axis=-1).ravel() for x in arrays]

    def _interpolate(self, x: _Numbers, places: Sequence[_Place]) -> SX:
        """Return the value at a place on each axis."""
        first, *others = places
        if not self.degree:
            return pick_numbers(first.row, x.corners[0])
        if not others:
            return first.interpolate(*(pick_numbers(first.row, y, 2) for y in x.corners))
        (second,) = others
        cell = first.row * (len(self.axes[1]) - 1) + second.row
        # Corners (0, 0), (0, 1), (1, 0), (1, 1) of the value and of its derivatives by the first,
        # by the second, and by both arguments.
        corners = [pick_numbers(4.0 * cell, y, 4) for y in x.corners]
        edges = []
        half = max(len(corners) // 2, 1)
        for k in range(half):
            columns = corners[k::half]
            ends = [second.interpolate(*(y[side : side + 2] for y in columns)) for side in (0, 2)]
            edges.append(ca.vertcat(*ends))
        return first.interpolate(*edges)

    def _express_piece(self, x: _Numbers, arguments: tuple[SX, ...], t: SX, at: SX) -> SX:
        """Return the smooth piece of a time law that is valid around t = `at`.

        Before and after the table, it is constant. Within the table, the polynomials at its ends
        are continued; derivatives at a row are those to its right. Repeated tables have one piece.
        """
        if self.is_repeated:
            arguments = self._wrap(x, arguments)
        places = []
        for argument, knots, limits in zip(arguments, x.axes, x.limits, strict=True):
            center = ca.substitute(argument, t, at)
            is_before, is_after = center < limits[0], center >= limits[1]
            if self.is_repeated:
                is_before = is_after = SX(0.0)
            row = find_row(argument if self.is_smooth else center, knots)
            # The row is arbitrary outside the table.
            row = ca.if_else(is_after, knots.numel() - 2.0, ca.if_else(is_before, 0.0, row))
            place = _Place.find(argument, knots, row)
            depth = ca.if_else(is_before, 0.0, place.depth)
            places.append(place._replace(depth=ca.if_else(is_after, place.length, depth)))
        value = self._interpolate(x, places)
        if len(arguments) > 1:
            return value
        # Without the rounding errors of the polynomial.
        value = ca.if_else(is_before, x.values[0], value)
        return ca.if_else(is_after, x.values[1], value)

    def kinks(self, axis: int) -> Array:
        """Return the arguments on an axis, within its range, at which value or slope jumps."""
        knots, values = self.axes[axis], np.moveaxis(self.values, axis, 0)
        if not self.degree:
            return knots[1:][np.diff(values) != 0.0]
        if self.is_smooth:
            return knots[[0, -1]] if not self.is_repeated else knots[:0]
        lengths = np.diff(knots).reshape(-1, *[1] * (values.ndim - 1))
        slopes = np.diff(values, axis=0) / lengths
        edge = np.zeros((1, *slopes.shape[1:]))
        jumps = np.abs(np.diff(np.concatenate([edge, slopes, edge]), axis=0))
        jumps = jumps.reshape(len(knots), -1).max(axis=1)
        return knots[jumps > _MIN_SLOPE_JUMP * np.max(np.abs(slopes), initial=0.0)]

    def list_knots(self, axis: int, low: float, high: float) -> Array:
        """Return the arguments at the rows; of repeated tables, those from `low` to `high`."""
        knots = self.axes[axis]
        if not self.is_repeated:
            return knots
        period = float(knots[-1] - knots[0])
        first, last = (int(np.floor((x - knots[0]) / period)) for x in (low, high))
        starts = period * np.arange(first, last + 1)
        return np.append((starts[:, None] + knots[:-1]).ravel(), starts[-1] + knots[-1])

    def describe_argument(self, axis: int, value: float) -> str:
        """Return a phrase about an argument outside the table."""
        knots = self.axes[axis]
        return (
            f"{self.arguments[axis]} = {value:.6g} leaves the range {knots[0]:.6g} to "
            f"{knots[-1]:.6g} of {self.name}"
        )


def _differentiate_axis(
    knots: Array, values: Array, axis: int, kind: str, is_repeated: bool
) -> Array:
    """Return the derivative of a cubic table by an argument, at its rows."""
    rows = np.moveaxis(values, axis, 0)
    return np.moveaxis(
        np.asarray(_interpolate_rows(knots, rows, kind, is_repeated)(knots, 1)), 0, axis
    )


def _bound_slopes(knots: Array, changes: Array, axis: int) -> Array:
    """Return the slope at each row that changes the values of both intervals by `changes`.

    Changes are the largest of the row and of its neighbors along the axis.
    """
    rows = np.moveaxis(changes, axis, 0)
    rows = np.concatenate([rows[:1], rows, rows[-1:]])
    largest = np.maximum.reduce([rows[:-2], rows[1:-1], rows[2:]])
    lengths = np.diff(knots)
    # A shorter length would also exclude slopes that matter in the longer interval.
    longest = np.maximum(np.append(lengths[0], lengths), np.append(lengths, lengths[-1]))
    return np.moveaxis(largest / longest.reshape(-1, *[1] * (rows.ndim - 1)), 0, axis)


def _interpolate_rows(knots: Array, values: Array, kind: str, is_repeated: bool) -> Any:
    """Return the piecewise cubic interpolation along the first axis."""
    # Imported here because the import takes as long as a short run, and few models have tables.
    from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator

    if kind == "spline":
        # Natural ends change the slope at the edges, where laws of drivers often begin at rest.
        return CubicSpline(knots, values, bc_type="periodic" if is_repeated else "not-a-knot")
    if not is_repeated:
        return PchipInterpolator(knots, values)
    # The slope of a row depends on both neighbors.
    before, after = knots[:1] - (knots[-1] - knots[-2]), knots[-1:] + (knots[1] - knots[0])
    periods = np.concatenate([values[-2:-1], values, values[1:2]])
    slopes = PchipInterpolator(np.concatenate([before, knots, after]), periods)(knots, 1)
    return CubicHermiteSpline(knots, values, slopes)


def warn_about_overshoot(result: Table) -> None:
    """Warn if a spline is far outside the values of two rows between them.

    In tables of two arguments, this is checked along the rows and the columns.
    """
    if result.kind != "spline":
        return
    low, high = float(result.values.min()), float(result.values.max())
    limit = max(_MAX_OVERSHOOT * (high - low), _MIN_OVERSHOOT * max(abs(low), abs(high)))
    excess, sentence = limit, ""
    kinds = "kind='linear'" if len(result.axes) > 1 else "kind='pchip' or kind='linear'"
    for axis, (name, knots) in enumerate(zip(result.arguments, result.axes, strict=True)):
        rows = np.moveaxis(result.values, axis, 0).reshape(len(knots), -1)
        arguments = knots[:-1] + np.outer(_OVERSHOOT_PLACES, np.diff(knots))
        values = _interpolate_rows(knots, rows, "spline", result.is_repeated)(arguments)
        lower, upper = np.minimum(rows[:-1], rows[1:]), np.maximum(rows[:-1], rows[1:])
        outside = np.maximum(values - upper, lower - values)
        k = np.unravel_index(np.argmax(outside), outside.shape)
        if outside[k] > excess:
            excess = float(outside[k])
            sentence = (
                f"{result.name}: the spline reaches {values[k]:.3g} at {name} = "
                f"{arguments[k[:2]]:.6g}, far outside the values {lower[k[1:]]:.6g} to "
                f"{upper[k[1:]]:.6g} of the rows beside it; use {kinds}, or add rows."
            )
    if sentence:
        warn_user(sentence, InputWarning)


def table(
    x: Any, y: Any, kind: str = "spline", outside: str = "hold", name: str | None = None
) -> Table:
    """Return a table: a function of one or two arguments that interpolates given values.

    Tables are time laws of loads and drivers, and functions in the formulas of force laws, springs
    and distributed forces, of any argument: `curve(tip.position[0])`. In a formula, an argument may
    be any expression.

    Parameters
    ----------
    x
        Ascending values of the argument, at least 2 (3 for "spline"); for two arguments, a pair of
        such lists.
    y
        Values, one for each entry of `x`; for two arguments, the rows belong to the first argument,
        shape (k, l).
    kind
        "previous" (the value of the last row at or before the argument, so that it jumps at the
        rows), for one argument and time laws only; "linear"; "pchip" (monotone between the rows,
        with a continuous slope; Fritsch & Butland, SIAM J. Sci. Stat. Comput. 5, 1984,
        doi:10.1137/0905021), for one argument only; or "spline" (cubic spline with a continuous
        second derivative and, at the second and the last but one row, a continuous third one, "not
        a knot"; it may overshoot, most of all next to steps between unequal intervals).
    outside
        Outside the range of `x`, "hold" keeps the value at the edge; with "error", runs stop where
        an argument leaves the range, with a reason that names the table, argument and value; and
        "repeat" continues the table periodically, for example over the turns of a crank, with the
        range of `x` as the period and splines that are smooth from period to period. Repeated
        tables have one argument, equal first and last values and not the kind "previous"; linear
        ones cannot be time laws.
    name
        Name in messages. Defaults to "table".

    Returns
    -------
    Table
        The table. As a time law, it has breakpoints at each time where its value or its slope
        jumps; steps of adaptive integrators are at most the shortest interval between times if it
        is a "pchip" or "spline".

    Raises
    ------
    BeamdaeError
        If the lists have different lengths, too few entries or entries that are not finite numbers,
        `x` does not ascend, `kind` or `outside` is unknown, `kind` is "previous" or "pchip" for two
        arguments, or a repeated table has two arguments, different values at its ends or the
        kind "previous".

    Warns
    -----
    BeamdaeWarning
        If a spline leaves the values of two rows between them by more than 0.15 of the range of
        `y`; for two arguments, this is checked along the rows and columns of the grid.

    Examples
    --------
    >>> import beamdae as bd
    >>> characteristic = bd.table([0.0, 0.01, 0.02], [0.0, 50.0, 300.0], kind="pchip")
    >>> round(characteristic(0.01), 6)
    50.0
    >>> mech = bd.Mechanism()
    >>> ball = mech.add(bd.PointMass("ball", 0.2, at=(1.0, 0.0)))
    >>> top = mech.ground.at(0.0, 0.0)
    >>> spring = mech.add(bd.Spring("spring", top, ball.point, law=characteristic))
    """
    label = "table" if name is None else require_name("table", name)
    result = create_table(label, x, y, kind, outside)
    warn_about_overshoot(result)
    return result


def create_table(label: str, x: Any, y: Any, kind: str, outside: str) -> Table:
    """Return the table of `table`; `label` is its name in messages."""
    require_choice(label, "kind", kind, KINDS)
    require_choice(label, "outside", outside, OUTSIDE)
    entries = require_sequence(label, "x", x, "a list of numbers or a pair of lists")
    if not entries or _is_list(entries[0]):
        if len(entries) != MAX_AXES:
            raise BeamdaeError(
                f"{label}: x must be a list of numbers or a pair of lists, got {len(entries)} "
                "lists."
            )
        axes = tuple(_require_axis(label, f"x[{k}]", e, kind) for k, e in enumerate(entries))
        rows = require_sequence(label, "y", y, "a list of rows")
        numbers = [_require_numbers(label, f"y[{k}]", row) for k, row in enumerate(rows)]
        if [len(row) for row in numbers] != [len(axes[1])] * len(axes[0]):
            lengths = ", ".join(str(len(row)) for row in numbers[:6])
            raise BeamdaeError(
                f"{label}: y must have {len(axes[0])} rows of {len(axes[1])} values, got "
                f"{len(numbers)} rows of lengths {lengths}."
            )
        if kind in ("previous", "pchip"):
            raise BeamdaeError(
                f"{label}: kind={kind!r} is not defined for two arguments; use 'linear' or "
                "'spline'."
            )
        if outside == "repeat":
            raise BeamdaeError(
                f"{label}: outside='repeat' is not defined for two arguments; repeat the rows of "
                "one period for the whole run."
            )
        return Table(label, axes, np.array(numbers), kind, outside, ("x[0]", "x[1]"))
    axis, values = _require_axis(label, "x", entries, kind), _require_numbers(label, "y", y)
    if axis.shape != values.shape:
        raise BeamdaeError(
            f"{label}: x and y must be lists of the same length, got {len(axis)} and {len(values)}."
        )
    if outside == "repeat" and kind == "previous":
        raise BeamdaeError(
            f"{label}: outside='repeat' is not defined for kind='previous'; repeat the rows of one "
            "period for the whole run."
        )
    if outside == "repeat":
        first, last = values[[0, -1]].tolist()
        if abs(last - first) > _MAX_GAP * np.max(np.abs(values)):
            one, other = format_distinct(first, last)
            raise BeamdaeError(
                f"{label}: with outside='repeat', the first and last values must be equal, got "
                f"{one} and {other}; end the table one period after its first row, with "
                "the value of this row."
            )
        values[-1] = first
    return Table(label, (axis,), values, kind, outside, ("x",))


def _is_list(value: Any) -> bool:
    try:
        require_sequence("table", "x", value, "a list")
    except BeamdaeError:
        return False
    return True


def _require_axis(part: str, name: str, values: Any, kind: str) -> Array:
    axis = _require_numbers(part, name, values)
    if len(axis) < _MIN_ROWS[kind]:
        raise BeamdaeError(
            f"{part}: {name} must have at least {_MIN_ROWS[kind]} entries for kind={kind!r}, got "
            f"{len(axis)}."
        )
    steps = np.diff(axis)
    k = int(np.argmin(steps))
    if steps[k] <= 0.0:
        remedy = (
            "reverse the order of the rows"
            if np.all(steps < 0.0)
            else f"sort the rows by {name} and give each value once, or make a table of each "
            "branch of a measured loop"
        )
        first, second = format_distinct(axis[k], axis[k + 1])
        raise BeamdaeError(
            f"{part}: {name} must ascend, but {first} is followed by {second}; {remedy}."
        )
    require_positive(part, f"the shortest interval of {name}", float(steps[k]))
    return axis


def _require_numbers(part: str, name: str, values: Any) -> Array:
    entries = require_sequence(part, name, values, "a list of numbers")
    return np.array([require_finite(part, name, value) for value in entries])
