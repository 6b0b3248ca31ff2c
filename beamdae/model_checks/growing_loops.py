"""Warnings about control loops that grow exponentially or alternate without decay.

Commands are values that sampled controllers hold, outputs of `pid`, and limited values in laws.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain, pairwise, product
from typing import NamedTuple

import numpy as np

from beamdae import deferred
from beamdae.equations.commands import Command, compile_commands
from beamdae.equations.controller_reads import evaluate_reads
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, name_with_others
from beamdae.model_checks.switching_laws import has_few_levels, is_switch
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.signals import State
from beamdae.results.rest import is_motionless
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Intervals of the second half of a run in which changes of values are compared. The largest changes
# in equal windows are the envelope of a vibration.
_INTERVALS = 256
# Numbers of windows: many for fast growth, few for slow vibrations.
_WINDOW_COUNTS = (8, 4)
# Commands may grow from the start until a limit or the geometry stops them, by a factor of at least
# 30 in the last half or in the last three quarters of this time; then four windows would be too few
# to exclude powers of time.
_GROWING_PARTS = {0.5: _WINDOW_COUNTS, 0.25: _WINDOW_COUNTS[:1]}
# Growth of the envelope in the second half of a run. Values that increase with the third power of
# time, such as integrals of positions at constant acceleration, grow by a factor of 4, or of 14
# from 0.4 of the run on.
_MIN_GROWTH = 30.0
_MAX_EXPONENT = 700.0  # of the growth; exp(710) overflows
# Fractions of the run from which on values may grow: fast growth from a step near the end of a run,
# or after a motion that ends the run soon.
_LAST_PARTS = {0.5: "second half", 0.75: "last quarter", 0.875: "last eighth"}
# Bounds of the exponents of growth from window to window, relative to their mean. They are 1 if the
# growth is exponential, and 0.7 to 1.35 for powers of time from 0.4 of the run on.
_LEAST_EXPONENT, _LARGEST_EXPONENT = 0.75, 1.33
# Changes below this fraction of the largest value of the run are rounding errors.
_ROUNDING = 1e-9
# Growth up to less than this fraction of the largest value of the run ends at no limit. Rounding
# errors grow at random, and errors of the integration by the dynamics of stable loops.
_MIN_GROWN_SHARE = 1e-4
# Commands may grow earlier and stop to grow at a limit of the law or of the motion: ends of such
# growth as fractions of the run.
_ENDS_OF_GROWTH = tuple(2.0 ** (-k / 4) for k in range(13))
# Smallest changes in the last quarter of the run, relative to those at the end of the growth.
_MIN_REMAINING_CHANGE = 0.5
# A held value alternates if it reverses within a few samples: the period is at most this multiple
# of the samples until a sample takes effect, ...
_MAX_PERIOD = 6.0
# ... in the last samples of the run, at most the second half of them, ...
_MAX_LAST_SAMPLES = 256
_MIN_LAST_SAMPLES = 16
# ... has at least this half range in them, relative to the largest value, ...
_MIN_AMPLITUDE = 0.2
# ... hardly decays from their first to their second half ...
_MIN_REMAINING_ALTERNATION = 0.9
# ... and repeats: the correlation with itself at one of the delays of a quarter to half of the last
# samples. Of 1311 stable loops (random plants, PID gains and delays, of them 700 with noise or
# quantization), 5 repeated: 2 followed sines with periods of less than 18 samples and a delay of 2
# samples, 3 were limit cycles of quantization or almost unstable. Noise reaches 0.5.
_MIN_CORRELATION = 0.8
# Samples of the reference that explain a held value, and the share of its standard deviation that
# they leave at most.
_REFERENCE_LAGS, _MAX_UNEXPLAINED = 4, 0.5
# Noise does not repeat. It is named if the value is at both of its limits in turn at least this
# often, once per this number of samples.
_MIN_REVERSALS = 6
_MAX_SAMPLES_PER_REVERSAL = 6
# A law rounds a measured value if its command is constant but for jumps at equal distances: at
# least four jumps, at a quarter of the samples at most, around the measured value. The value of an
# encoder in a limit cycle of quantization changes by few of these steps.
_ROUNDING_SAMPLES, _MAX_DOUBLINGS = 129, 6
_MIN_EQUAL_STEPS, _MAX_SHARE_OF_JUMPS, _MAX_ROUNDING_STEPS = 3, 0.25, 4.0
# Range in the run relative to that in the last samples: in a run at rest, all of the motion is
# flicker of the encoder.
_MIN_SETTLING = 1.5
# Slower vibrations between both limits are compared in 256 of the last samples at these strides.
# Of 216 loops (PID on a mass with a spring, gains 0.3 to 4 times the limit of stability), 92 of the
# 93 that went from limit to limit in the last quarter were found; none of the 84 stable ones was.
_STRIDES = (1, 4, 16)
_MIN_CYCLE_SWITCHES = 4
# Decrease of the ranges of measured values from the first to the second half of these samples.
_MAX_DECAY = 0.03
# Commands of continuous loops are compared at this number of times in the last parts of a run. Of
# 95 unstable loops (PID with a lag on a mass with a spring and on a stage with two leaf springs, 1
# to 100 times the critical gain, 10 to 60 periods), 65 have a warning; 13 others grow by less than
# a factor of 30, and most of the rest last for few periods or have limits of a small fraction of
# the first command. Of 45 stable ones (0.1 to 1 times the critical gain), 30 with weak actuators
# and 30 turning wheels, none has one.
_CYCLE_PARTS, _CYCLE_SAMPLES = (0.75, 0.375, 0.1875), 512
# Decrease of the ranges of commands and of measured values from the first to the second half of
# these times in the longest part; in a shorter one, it is compared with that in the part before,
# which is twice as long. It is half of the latter if the vibration decays steadily.
_MAX_FIRST_DECAY, _MAX_DECAY_RATIO, _DECAY_ROUNDING = 0.01, 0.2, 2e-3
# Ranges of commands before the limits, relative to the distance of the limits. Commands of unstable
# loops exceed them in proportion to the gains, unless they grow. Weak actuators, whose commands are
# much larger, damp vibrations so slowly that they hardly decay.
_MAX_EXCESS = 200.0
# Motions by more than this fraction of their scale, whose mean in the second half differs from that
# in the first half by more than this fraction of their range, go on.
_MIN_TRAVEL, _MIN_SHIFT = 0.1, 0.25
# Continuous commands are sampled in the last half of the run, in the quarter before it, and so on,
# because unstable loops may grow at the start only.
_HISTORY_PARTS, _SAMPLES_PER_PART = 9, 256
# Logarithms of the ratios of consecutive swings: at least three, of which none is smaller than
# this, or larger than twice the smallest one.
_MIN_GROWING_SWINGS, _MIN_SWING_EXPONENT, _MAX_EXPONENT_RATIO = 3, 0.15, 2.0
# Ranges of signals of loops that do not settle: in the last quarter of the run relative to the
# whole run, and in the whole run relative to that while a growing mode grows by a factor of e.
# Without laws that change, it suffices if that in the last quarter is at least half of the latter:
# the growth may end at a limit soon. In runs of a stage with two masses and a filtered PID (1 to
# 10 s), all of 198 unstable loops that grow by more than a factor of 30, 96 of them sampled, have a
# warning, and none of 162 stable ones. In runs of 5 to 40 swings of a mass with a PID with random
# gains and limits, 191 of 200 unstable loops (100 with a slow actuator, 100 sampled at least 8
# times), and none of 200 stable ones.
_MIN_LAST_SHARE, _MIN_DEPARTURE = 0.3, 4.0
# Growth of this mode in the run. A resonance grows without such a mode.
_MIN_MODE_GROWTH = 5.0
# Samples of a run from which on, and at most, measured and held values are evaluated
_MIN_READ_SAMPLES, _MAX_READ_SAMPLES = 8, 2048
# Laws that change by more than this share of their largest value in the last samples may excite the
# loop until the end.
_MAX_LAW_CHANGE = 0.01
_LAW_SAMPLES = 33


def growing_loop_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning if a command of a controller or a state grows, or does not settle.

    An unstable loop reaches the end of a run if it grows slowly or the run is short. Values that
    increase like ramps, steps and powers of time have no warning.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    rows, commands = _describe_rows(equations), compile_commands(equations)
    if not (rows or commands) or not trajectory.end > trajectory.start:
        return
    if is_motionless(equations, trajectory):
        return
    start, duration = trajectory.start, trajectory.end - trajectory.start
    histories = list(_list_histories(trajectory, commands))

    def values(begin: float, end: float, selected: Sequence[int]) -> Array:
        times = start + duration * np.linspace(begin, end, _INTERVALS + 1)
        columns = [np.interp(times, x.times, x.values)[:, None] for x in histories]
        if selected:
            columns.insert(0, trajectory.positions_at(times, selected))
        return np.hstack(columns)

    labels = [*rows.values(), *((x.command.name, "gains") for x in histories)]
    of_rows = np.abs(values(0.0, 1.0, list(rows))[:, : len(rows)]).max(axis=0)
    of_commands = np.array([np.abs(x.values).max() for x in histories])
    largest = np.concatenate([of_rows, of_commands])
    for begin, part in _LAST_PARTS.items():
        growth = _exponential_growth(values(begin, 1.0, list(rows)), largest)
        k = int(np.argmax(growth))
        if growth[k] > 0.0:
            name, remedy = labels[k]
            yield (
                f"{name} grows exponentially, by a factor of {growth[k]:.2g} in the {part} of the "
                f"run, so its loop seems to be unstable; check the signs and sizes of its {remedy}."
            )
            return
    held = [
        term.rows.start + k
        for term in equations.controllers
        for k in range(len(term.controller.drives))
    ]
    labels = [*(rows[x] for x in held), *labels[len(rows) :]]
    if not labels:
        return
    is_command = np.isin(list(rows), held)
    largest = np.concatenate([of_rows[is_command], of_commands])
    limited = list(
        _limited_growth_warnings(trajectory, labels, partial(values, selected=held), largest)
    )
    warnings = limited or list(
        chain(
            _swing_warnings(equations, histories),
            _sampled_cycle_warnings(equations, trajectory, rows),
            _cycle_warnings(equations, trajectory, histories),
        )
    )
    yield from warnings or _growing_mode_warnings(equations, trajectory, histories, rows)


class _History(NamedTuple):
    """Continuous command before its limits, and its signals (k, n), at ascending times [s]."""

    command: Command
    times: Array
    values: Array
    signals: Array


def _list_histories(trajectory: Trajectory, commands: Sequence[Command]) -> Iterator[_History]:
    """Yield the values of commands in the last half of a run, in the quarter before it, etc."""
    if not commands:
        return
    ends = [0.0, *(2.0 ** -np.arange(_HISTORY_PARTS - 1.0, -1.0, -1.0))]
    shares = [np.linspace(*x, _SAMPLES_PER_PART, endpoint=False) for x in pairwise(ends)]
    duration = trajectory.end - trajectory.start
    times = trajectory.start + duration * np.append(np.concatenate(shares), 1.0)
    at = trajectory.at(times)
    for command in commands:
        values = command.evaluate(*at)
        yield _History(command, times, values[:, 0], values[:, 1:])


def _limited_growth_warnings(
    trajectory: Trajectory,
    labels: Sequence[tuple[str, str]],
    values: Callable[[float, float], Array],
    largest: Array,
) -> Iterator[str]:
    """Yield a warning if a command grows up to a limit, and does not decay again.

    `values` returns the commands with names and remedies `labels` at times from one fraction of the
    run to another one, and `largest` their largest magnitudes in the run.
    """
    remaining = np.abs(np.diff(values(0.75, 1.0), axis=0)).max(axis=0)
    duration = trajectory.end - trajectory.start
    # Loops reach limits at different times: the first window of growth by number
    growths: dict[int, _Growth] = {}
    for end, (part, counts) in product(_ENDS_OF_GROWTH, _GROWING_PARTS.items()):
        growing = values(part * end, end)
        changes = np.abs(np.diff(growing, axis=0)).max(axis=0)
        goes_on = remaining >= _MIN_REMAINING_CHANGE * changes
        goes_on &= changes >= _MIN_GROWN_SHARE * largest
        growth = np.where(goes_on, _exponential_growth(growing, largest, counts), 0.0)
        begin, last = (trajectory.start + x * duration for x in (part * end, end))
        for k in np.flatnonzero(growth).tolist():
            growths.setdefault(k, _Growth(*labels[k], float(growth[k]), begin, last))
    yield from _describe_growths(list(growths.values()))


class _Growth(NamedTuple):
    """Exponential growth of a command by a factor between two times [s]."""

    name: str
    remedy: str
    factor: float
    begin: float
    end: float

    @property
    def rate(self) -> float:
        return float(np.log(self.factor)) / (self.end - self.begin)


def _describe_growths(growths: Sequence[_Growth]) -> Iterator[str]:
    """Yield a warning about the fastest growth, with the names of the others, if there are any."""
    if growths:
        fastest, *others = sorted(growths, key=lambda x: -x.rate)
        names = dict.fromkeys(x.name for x in others if x.name != fastest.name)
        yield (
            f"{name_with_others(fastest.name, list(names))} grows exponentially, by a factor of "
            f"{fastest.factor:.2g} from t = {fastest.begin:.3g} to {fastest.end:.3g} s, and does "
            "not decay again, so its loop seems to be unstable; check the signs and sizes of its "
            f"{fastest.remedy}."
        )


def _swing_warnings(equations: EquationsOfMotion, histories: Sequence[_History]) -> Iterator[str]:
    """Yield a warning if few swings of a continuous command grow, and do not decay again."""
    growths = []
    for command, times, values, _ in histories:
        growth = _find_growing_swings(values)
        if growth is not None:
            factor, first, last = growth
            if not _has_varying_laws(equations.mechanism, times[first : last + 1]):
                growths.append(_Growth(command.name, "gains", factor, times[first], times[last]))
    yield from _describe_growths(growths)


def _find_growing_swings(values: Array) -> tuple[float, int, int] | None:
    """Return the growth of consecutive swings, and their first and last sample, or None."""
    directions = np.sign(np.diff(values))
    (moving,) = np.nonzero(directions)
    turns = moving[np.append(directions[moving[1:]] != directions[moving[:-1]], True)] + 1
    turns = np.append(0, turns)
    swings = np.abs(np.diff(values[turns]))
    if len(swings) <= _MIN_GROWING_SWINGS:
        return None
    exponents = np.diff(np.log(swings))
    remaining = np.max(swings[-max(len(swings) // 4, 1) :])
    smallest_end = _MIN_GROWN_SHARE * np.max(swings)
    best = None
    for last in range(_MIN_GROWING_SWINGS, len(exponents) + 1):
        if not smallest_end <= swings[last] <= remaining / _MIN_REMAINING_CHANGE:
            continue
        smallest = largest = exponents[last - 1]
        first = last
        while first > 0:
            low, high = min(smallest, exponents[first - 1]), max(largest, exponents[first - 1])
            if low < _MIN_SWING_EXPONENT or high > _MAX_EXPONENT_RATIO * low:
                break
            smallest, largest, first = low, high, first - 1
        factor = float(swings[last] / swings[first])
        is_growing = last - first >= _MIN_GROWING_SWINGS and factor > _MIN_GROWTH
        if is_growing and (best is None or factor > best[0]):
            best = factor, int(turns[first]), int(turns[last + 1])
    return best


def _sampled_cycle_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, rows: dict[int, tuple[str, str]]
) -> Iterator[str]:
    """Yield a warning if a held value alternates without decay."""
    for stream, term in enumerate(equations.controllers):
        controller = term.controller
        # Without measured values, there is no loop.
        if not controller.reads:
            continue
        first, last = _sampled_intervals(trajectory, controller.every)
        if _has_varying_laws(equations.mechanism, last):
            continue
        held = trajectory.positions_at(np.concatenate([first, last]))[:, term.rows]
        for k in range(len(controller.drives)):
            limits = _find_alternation(held[:, k], len(first), 1 + controller.delay)
            if limits is not None and _follows_reference(equations, trajectory, stream, k, last):
                continue
            is_levels = limits is not None and has_few_levels(held[:, k], limits)
            if is_levels and _is_switch(equations, trajectory, stream, k, last):
                continue
            if limits is not None:
                name, remedy = rows[term.rows.start + k]
                yield (
                    f"{name} alternates between {limits[0]:.4g} and {limits[1]:.4g} within a few "
                    "samples until the end of the run, so its loop seems to be unstable or hardly "
                    "damped, or to amplify noise or quantization; check the signs and sizes of its "
                    f"{remedy}."
                )
                return
            cycle = _find_limit_cycle(equations, trajectory, stream, k)
            if cycle is not None:
                yield _describe_cycle(*rows[term.rows.start + k], *cycle)
                return
            rounded = list(_quantization_warnings(equations, trajectory, stream, k, last))
            if rounded:
                yield from rounded
                return


def _describe_cycle(name: str, remedy: str, low: float, high: float) -> str:
    return (
        f"{name} alternates between its limits {low:.4g} and {high:.4g} until the end of the run "
        "(limit cycle), so its loop seems to be unstable; check the signs and sizes of its "
        f"{remedy}."
    )


def _cycle_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, histories: Sequence[_History]
) -> Iterator[str]:
    """Yield a warning if a command of a continuous loop goes from limit to limit without decay."""
    duration = trajectory.end - trajectory.start
    for command, times, history, _ in histories:
        low, high = command.low, command.high
        is_last = times > trajectory.end - duration * max(_CYCLE_PARTS)
        if not (command.has_limits and _has_cycles(history[is_last], low, high)):
            continue
        decay = None
        for part in _CYCLE_PARTS:
            times = trajectory.end - duration * part * np.linspace(1.0, 0.0, _CYCLE_SAMPLES)
            if _has_varying_laws(equations.mechanism, times):
                continue
            at = trajectory.at(times)
            values = command.evaluate(*at)
            max_decay = _MAX_FIRST_DECAY
            if decay is not None:
                max_decay = max(min(_MAX_DECAY_RATIO * decay, _MAX_DECAY), _DECAY_ROUNDING)
            decay = _find_decay(values)
            excess = np.ptp(values[:, 0]) / (high - low)
            is_persistent = (
                decay <= max_decay
                and (excess < _MAX_EXCESS or decay < -_MAX_FIRST_DECAY)
                and _has_cycles(values[:, 0], low, high)
                and _repeats(np.clip(values[:, 0], low, high), np.inf)
                and not _moves_on(equations, at[1].q)
            )
            if is_persistent:
                yield _describe_cycle(command.name, "gains", low, high)
                return


def _has_cycles(values: Array, low: float, high: float) -> bool:
    """Return True if values go from limit to limit, or beyond them, several times."""
    return _count_switches(np.clip(values, low, high), low, high) >= _MIN_CYCLE_SWITCHES


def _count_switches(values: Array, low: float, high: float) -> int:
    """Return how often values go from one of their limits to the other one."""
    rounding = _ROUNDING * max(abs(low), abs(high))
    is_low, is_high = values <= low + rounding, values >= high - rounding
    return int(np.count_nonzero(np.diff(is_high[is_low | is_high])))


def _find_decay(values: Array) -> float:
    """Return the largest relative decrease of the ranges of columns (k, n) in their second half."""
    half = len(values) // 2
    early, late = np.ptp(values[:half], axis=0), np.ptp(values[half:], axis=0)
    return float(np.max((early - late)[early > 0.0] / early[early > 0.0], initial=-np.inf))


def _moves_on(equations: EquationsOfMotion, q: Array) -> bool:
    """Return True if parts turn or travel, so that forces along their way may be periodic."""
    half = len(q) // 2
    ranges = np.ptp(q, axis=0)
    shifts = np.abs(q[half:].mean(axis=0) - q[:half].mean(axis=0))
    is_moving = ranges > _MIN_TRAVEL * equations.position_scales
    is_moving[list(equations.states)] = False
    return bool(np.any(is_moving & (shifts > _MIN_SHIFT * ranges)))


def _find_limit_cycle(
    equations: EquationsOfMotion, trajectory: Trajectory, stream: int, drive: int
) -> tuple[float, float] | None:
    """Return the limits between which a held value goes back and forth without decay, or None."""
    term = equations.controllers[stream]
    every = term.controller.every
    samples = np.arange(np.ceil(trajectory.start / every), np.floor(trajectory.end / every))
    samples = samples[len(samples) // 2 :]
    for stride in _STRIDES:
        times = every * (samples[::-stride][:_MAX_LAST_SAMPLES][::-1] + 0.5)
        if len(times) < _MIN_LAST_SAMPLES:
            return None
        held = trajectory.positions_at(times)[:, term.rows.start + drive]
        low, high = float(held.min()), float(held.max())
        # Without limits, a vibration has both extremes in each period only if the period is a whole
        # number of samples.
        if not (_has_cycles(held, low, high) and _repeats(held, np.inf)):
            continue
        if _has_varying_laws(equations.mechanism, times):
            return None
        states = trajectory.at(times)
        reads = evaluate_reads(term, equations.p, *states)
        if _find_decay(reads) > _MAX_DECAY or _moves_on(equations, states[1].q):
            continue
        newest = every * (samples[-_MAX_LAST_SAMPLES:] + 0.5)
        if _follows_reference(equations, trajectory, stream, drive, newest):
            return None
        is_levels = has_few_levels(held, (low, high))
        if not is_levels or not _is_switch(equations, trajectory, stream, drive, newest):
            return low, high
    return None


def _growing_mode_warnings(
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    histories: Sequence[_History],
    rows: dict[int, tuple[str, str]],
) -> Iterator[str]:
    """Yield a warning if a loop does not settle, and its linearization explains the growth."""
    assert equations.mechanism is not None
    outputs = [x for x in histories if x.command.is_output]
    # Commands after a step exceed the limits by a factor of up to hundreds.
    signals: list[tuple[str, str, Array, Array]] = [
        (
            x.command.name,
            "gains",
            x.times,
            np.column_stack([np.clip(x.values, x.command.low, x.command.high), x.signals]),
        )
        for x in outputs
    ]
    if equations.controllers:
        signals = list(_list_sampled_signals(equations, trajectory, rows))
    signals = [x for x in signals if _find_last_share(*x[2:]) > _MIN_LAST_SHARE]
    if not signals:
        return
    loops = deferred.module("analysis.linear_dynamics.loop_stability")
    mode = loops.find_growing_mode(equations, trajectory, [x.command for x in outputs])
    duration = trajectory.end - trajectory.start
    if mode is None or mode.rate * duration < np.log(_MIN_MODE_GROWTH):
        return
    last = trajectory.end - 0.25 * duration
    is_driven = _has_varying_laws(equations.mechanism, np.array([last, trajectory.end]))
    for name, remedy, times, values in signals:
        early = np.ptp(values[times <= trajectory.start + 1.0 / mode.rate], axis=0)
        departs = np.ptp(values, axis=0) > _MIN_DEPARTURE * early
        if not is_driven:
            departs |= np.ptp(values[times >= last], axis=0) > _MIN_REMAINING_CHANGE * early
        if departs.any():
            vibrates = f" and vibrates at {mode.frequency:.3g} Hz" if mode.frequency else ""
            yield (
                f"{name} does not settle, and a mode of the loop linearized about the start of the "
                f"run grows as exp({mode.rate:.3g} t){vibrates}, so its loop seems to be unstable; "
                f"check the signs and sizes of its {remedy}."
            )
            return


def _list_sampled_signals(
    equations: EquationsOfMotion, trajectory: Trajectory, rows: dict[int, tuple[str, str]]
) -> Iterator[tuple[str, str, Array, Array]]:
    """Yield name, remedy, times [s] and the values (k, n) that each controller reads and holds."""
    for term in equations.controllers:
        every = term.controller.every
        first, last = np.ceil(trajectory.start / every), np.floor(trajectory.end / every)
        samples = np.unique(np.linspace(first, last, _MAX_READ_SAMPLES).astype(int))
        if not term.controller.reads or last - first < _MIN_READ_SAMPLES:
            continue
        times, state = trajectory.at(every * samples)
        reads = evaluate_reads(term, equations.p, times, state)
        drives = slice(term.rows.start, term.rows.start + len(term.controller.drives))
        between = np.minimum(times[:, 0] + 0.5 * every, trajectory.end)
        held = trajectory.positions_at(between)[:, drives]
        yield (*rows[term.rows.start], times[:, 0], np.hstack([reads, held]))


def _find_last_share(times: Array, values: Array) -> float:
    """Return the largest range of a column in the last quarter, relative to the whole run."""
    is_last = times >= times[0] + 0.75 * np.ptp(times)
    ranges, last = np.ptp(values, axis=0), np.ptp(values[is_last], axis=0)
    return float(np.max(last[ranges > 0.0] / ranges[ranges > 0.0], initial=0.0))


def _sampled_intervals(trajectory: Trajectory, every: float) -> tuple[Array, Array]:
    """Return times [s] within the first and the last intervals between samples of a run."""
    first, last = np.ceil(trajectory.start / every), np.floor(trajectory.end / every)
    at = every * (np.arange(first, last) + 0.5)
    count = min(len(at) // 2, _MAX_LAST_SAMPLES)
    return at[: len(at) - count][:_MAX_LAST_SAMPLES], at[len(at) - count :]


def _has_varying_laws(mechanism: Mechanism | None, times: Array) -> bool:
    """Return True if a time law of the mechanism changes between the first and last of `times`."""
    if mechanism is None or not len(times):
        return False
    # Multiples of the golden ratio do not coincide with the period of a law.
    shares = np.arange(_LAW_SAMPLES) * 0.5 * (np.sqrt(5.0) - 1.0) % 1.0
    for law in mechanism.laws:
        # Formulas of inputs have no value; laws of the inputs are among those of the mechanism.
        with contextlib.suppress(BeamdaeError):
            values = np.array([law.at(t) for t in times[0] + shares * np.ptp(times)])
            if np.ptp(values) > _MAX_LAW_CHANGE * np.abs(values).max():
                return True
    return False


def _find_alternation(held: Array, n_first: int, latency: int) -> tuple[float, float] | None:
    """Return the limits of a held value that alternates until the end of a run, or None.

    Parameters
    ----------
    held
        Values after the first samples of the run, of which there are `n_first`, and the last ones.
    latency
        Number of samples until a sample takes effect.
    """
    last = held[n_first:]
    if len(last) < _MIN_REVERSALS:
        return None
    low, high = float(last.min()), float(last.max())
    switches = _count_switches(last, low, high)
    is_at_limits = switches >= max(_MIN_REVERSALS, len(last) / _MAX_SAMPLES_PER_REVERSAL)
    if 0.5 * (high - low) < _MIN_AMPLITUDE * np.abs(held).max():
        return None
    return (low, high) if is_at_limits or _repeats(last, _MAX_PERIOD * latency) else None


def _follows_reference(
    equations: EquationsOfMotion, trajectory: Trajectory, stream: int, drive: int, last: Array
) -> bool:
    """Return True if a held value alternates because the reference in the law of a controller does.

    Without feedback, the law is called with the measured values of the mean state, which change
    with time only. The held value follows the reference if it is a linear combination of the
    results at a few samples, of a constant and of a ramp. A loop that is unstable alternates at
    another frequency.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    stream
        Number of the controller in the mechanism.
    drive
        Number of the driven input.
    last
        Times [s] in the middle between the last samples.
    """
    term = equations.controllers[stream]
    controller = term.controller
    samples = last - 0.5 * controller.every
    times, states = trajectory.at(samples)
    q, v = (np.broadcast_to(x.mean(axis=0), x.shape) for x in (states.q, states.v))
    reads = evaluate_reads(term, equations.p, times, states._replace(q=q, v=v))
    values = trajectory.positions_at(last)[:, term.rows]
    held, before = values[:, drive], values[0]
    newest = len(controller.drives) * controller.delay + drive
    first = round(samples[0] / controller.every)
    try:
        # Noise alternates without feedback, too, but is no reference.
        start = samples[0], first, reads[0], before
        one, other = (controller.next_values(*start, stream + k) for k in (0, 1))
        has_noise = not np.array_equal(one, other)
        of_reference = []
        for k, (time, read) in enumerate(zip(samples.tolist(), reads, strict=True)):
            index = first if has_noise else first + k
            before = controller.next_values(time, index, read, before, stream)
            of_reference.append(before[newest])
    except BeamdaeError:
        return False
    lags = range(_REFERENCE_LAGS)
    count = len(held) - _REFERENCE_LAGS
    columns = [of_reference[_REFERENCE_LAGS - k : len(held) - k] for k in lags]
    matrix = np.column_stack([*columns, np.ones(count), np.arange(count)])
    scaled = matrix / np.maximum(np.abs(matrix).max(axis=0), np.finfo(float).tiny)
    held = held[_REFERENCE_LAGS:]
    rest = held - scaled @ np.linalg.lstsq(scaled, held, rcond=_ROUNDING)[0]
    return bool(np.std(rest) < _MAX_UNEXPLAINED * np.std(held))


def _is_switch(
    equations: EquationsOfMotion, trajectory: Trajectory, stream: int, drive: int, last: Array
) -> bool:
    """Return True if the law of a controller jumps between its limits, such as that of a relay.

    A law with limits, such as a saturated PID controller, has values between them.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    stream
        Number of the controller in the mechanism.
    drive
        Number of the driven input.
    last
        Times [s] in the middle between the last samples.
    """
    law = _law_at_largest_change(equations, trajectory, stream, drive, last)
    return is_switch(law.evaluate, law.begin, law.end, law.commands)


class _Law(NamedTuple):
    """Law of a controller between the two samples at which its command changes most.

    Attributes
    ----------
    evaluate
        Function from measured and held values to the command.
    begin, end
        Measured and held values at both samples.
    commands
        Command at both samples.
    """

    evaluate: Callable[[Array], float]
    begin: Array
    end: Array
    commands: tuple[float, float]


def _law_at_largest_change(
    equations: EquationsOfMotion, trajectory: Trajectory, stream: int, drive: int, last: Array
) -> _Law:
    """Return the law at the largest change of a command; see `_is_switch` for the parameters."""
    term = equations.controllers[stream]
    controller = term.controller
    # The newest values of the queue follow from the last sample.
    newest = len(controller.drives) * controller.delay + drive
    values = trajectory.positions_at(last)[:, term.rows]
    command = values[:, newest]
    k = 1 + int(np.argmax(np.abs(np.diff(command[1:]))))
    samples = last[k : k + 2] - 0.5 * controller.every
    times, states = trajectory.at(samples)
    reads = evaluate_reads(term, equations.p, times, states)
    begin, end = np.hstack([reads, values[k - 1 : k + 1]])
    index = round(samples[0] / controller.every)

    def evaluate(measured_and_held: Array) -> float:
        reads, before = np.split(measured_and_held, [len(begin) - values.shape[1]])
        return float(controller.next_values(samples[0], index, reads, before, stream)[newest])

    return _Law(evaluate, begin, end, (command[k], command[k + 1]))


def _quantization_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, stream: int, drive: int, last: Array
) -> Iterator[str]:
    """Yield a warning if a law that rounds a measured value amplifies the steps of the rounding.

    In the last samples, the measured value changes by few steps, and less than before, and the
    command goes to and fro by a large part of its largest value in the run. The parameters are
    those of `_is_switch`.
    """
    term = equations.controllers[stream]
    controller, row = term.controller, term.rows.start + drive
    if len(last) < _MIN_LAST_SAMPLES:
        return
    held = trajectory.positions_at(last)[:, row]
    low, high = float(held.min()), float(held.max())
    largest = max(float(np.abs(x.state.q[:, row]).max()) for x in trajectory.intervals)
    if 0.5 * (high - low) < _MIN_AMPLITUDE * largest:
        return
    inner = 0.25 * (high - low)
    halves = np.array_split(np.clip(held, low + inner, high - inner), 2)
    switches = (_count_switches(x, low + inner, high - inner) for x in halves)
    if min(switches) < _MIN_CYCLE_SWITCHES:
        return
    first, end = last[0] - 0.5 * controller.every, last[-1]
    times = np.concatenate([np.linspace(trajectory.start, first, _MAX_LAST_SAMPLES), last])
    reads = evaluate_reads(term, equations.p, *trajectory.at(times))
    ranges = np.ptp(reads[_MAX_LAST_SAMPLES:], axis=0)
    is_settled = np.ptp(reads, axis=0) > _MIN_SETTLING * ranges
    if _follows_reference(equations, trajectory, stream, drive, last):
        return
    law = _law_at_largest_change(equations, trajectory, stream, drive, last)
    for k in np.flatnonzero(is_settled & (ranges > 0.0)).tolist():
        step = _find_rounding_step(law, k, float(ranges[k]))
        if step is not None and ranges[k] <= _MAX_ROUNDING_STEPS * step:
            unit = "" if controller.reads[k].unit == "-" else f" {controller.reads[k].unit}"
            yield (
                f"{controller.name}: {controller.drives[drive].name} alternates between "
                f"{low:.4g} and {high:.4g} from t = {first:.3g} to {end:.3g} s, because the law "
                f"rounds {controller.reads[k].name} in steps of {step:.2g}{unit}, while it changes "
                f"by only {ranges[k]:.2g}{unit} (limit cycle of the loop); use smaller steps, or a "
                "smaller or filtered derivative."
            )
            return


def _find_rounding_step(law: _Law, read: int, span: float) -> float | None:
    """Return the step in which a law rounds a measured value that changes by `span`, or None."""
    for factor in 2.0 ** np.arange(_MAX_DOUBLINGS):
        shifts = factor * span * np.linspace(-1.0, 1.0, _ROUNDING_SAMPLES)
        values = np.repeat(law.begin[None], len(shifts), axis=0)
        values[:, read] += shifts
        try:
            commands = np.array([law.evaluate(x) for x in values])
        except BeamdaeError:
            return None
        jumps = shifts[1:][np.diff(commands) != 0.0]
        if len(jumps) > _MAX_SHARE_OF_JUMPS * len(shifts):
            return None
        steps = np.diff(jumps)
        if len(steps) >= _MIN_EQUAL_STEPS:
            is_equal = np.ptp(steps) <= 2.01 * (shifts[1] - shifts[0])
            return float(np.mean(steps)) if is_equal else None
    return None


def _repeats(values: Array, max_period: float) -> bool:
    """Return True if values alternate with a period of few samples, without decay."""
    if len(values) < _MIN_LAST_SAMPLES:
        return False
    half = len(values) // 2
    changes = np.diff(values)
    directions = np.sign(changes[changes != 0.0])
    reversals = np.count_nonzero(directions[1:] != directions[:-1])
    early, late = np.std(changes[:half]), np.std(changes[-half:])
    if 2.0 * len(values) > max_period * reversals or late < _MIN_REMAINING_ALTERNATION * early:
        return False
    x = values - values.mean()
    correlations = (
        x[k:] @ x[:-k] / np.sqrt(x[k:] @ x[k:] * (x[:-k] @ x[:-k])) for k in range(half // 2, half)
    )
    return max(correlations) > _MIN_CORRELATION


def _describe_rows(equations: EquationsOfMotion) -> dict[int, tuple[str, str]]:
    """Return name and remedy of the coordinates that controllers hold, and of other states.

    States on which nothing depends, such as the work of a load, belong to no loop.
    """
    acting = _find_acting_states(equations)
    rows = {
        k: (part.name, "gains")
        for part in equations.parts
        if part.is_state and part.name in acting
        for k in range(part.rows.start, part.rows.stop)
    }
    for term in equations.controllers:
        for k, drive in enumerate(term.controller.drives):
            name = f"{term.controller.name}: {drive.name}"
            rows[term.rows.start + k] = name, "gains, and every="
    return rows


def _find_acting_states(equations: EquationsOfMotion) -> set[str]:
    """Return the names of the states on which loads or controllers depend, also by other states."""
    sources = {
        part.name: {x.signal.name for force in forces for x in force.signals}
        for part, _, forces in equations.statements
    }
    controllers = [x.controller for x in equations.controllers]
    states = {x.name for x in equations.parts if x.is_state} - {x.name for x in controllers}
    reads = {x.name for y in controllers for x in y.reads if isinstance(x, State)}
    of_loads = (names for part, names in sources.items() if part not in states)
    acting = reads.union(*of_loads) & states
    while more := acting.union(*(sources.get(x, set()) for x in acting)) & states - acting:
        acting |= more
    return acting


def _exponential_growth(
    values: Array, largest: Array, counts: Sequence[int] = _WINDOW_COUNTS
) -> Array:
    """Return the growth factor of each column of values (k, size); 0 if not exponential.

    `largest` are the largest magnitudes of the columns in the run, (size,).
    """
    changes = np.abs(np.diff(values, axis=0))
    rounding = _ROUNDING * largest
    factors = np.zeros(values.shape[1])
    for count in counts:
        envelope = changes.reshape(count, -1, values.shape[1]).max(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            exponents = np.diff(np.log(envelope), axis=0)
            mean = exponents.mean(axis=0)
            relative = exponents / mean
            growth = np.exp(np.minimum(count * mean, _MAX_EXPONENT))
        is_uniform = (relative > _LEAST_EXPONENT) & (relative < _LARGEST_EXPONENT)
        is_growing = (growth > _MIN_GROWTH) & is_uniform.all(axis=0)
        is_growing &= (envelope > rounding).all(axis=0)
        factors = np.maximum(factors, np.where(is_growing, growth, 0.0))
    return factors
