"""Repetition of runs with more accurate beams, and the changes of their columns."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from beamdae import deferred
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import BeamdaeError, format_percent, name_with_others
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM
from beamdae.results.columns import (
    UNITS_OF_POSITIONS,
    Header,
    mark_unresolved_columns,
    remove_unit,
)
from beamdae.results.diagnostics.meshes.beam_ranges import MAX_UNREPORTED_ERROR, BeamDoubt
from beamdae.results.diagnostics.meshes.coarse_elements import (
    LARGE_CHANGE,
    MIN_SHARE,
    MIN_SHARE_AT_REST,
    describe_changes_of_rates,
    find_changes,
    peaks_of_rates,
    scales_of_columns,
)
from beamdae.results.diagnostics.meshes.mesh_errors import (
    find_negligible_columns,
    states_at_nodes,
)
from beamdae.results.run_data import RunData, find_drift
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.equations.assembly.refined_beams import RefinedBeams

Array = np.ndarray

# Repeats a run with other equations, given a similar motion with their coordinates.
RunAgain = Callable[[EquationsOfMotion, Trajectory], RunData | None]

# Steps times coordinates of runs that are repeated, which takes up to about two seconds.
_MAX_WORK = 2e5
# Larger differences of positions may be those of a chaotic motion: it amplifies changes of the
# velocities at the start, here by this share of their largest values. Of 20 runs with such
# differences, two double pendulums amplify them by 2e3 and 7e4, and the others by up to 100.
_LARGE_DIFFERENCE, _START_CHANGE, _MIN_AMPLIFICATION = 0.05, 1e-6, 1e3
_ROUNDED_CHANGE = 1e-3  # of a range; smaller ones are not stated
# Changes that are smaller, relative to the largest column of its kind, may be errors of the time
# integration: 1 % of a column of 1 % of the largest one, 10 % of parasitic motions of 0.1 %. They
# are stated if these errors are estimated at less than this share of the change. In 73 runs of
# stages, press rods, wipers and the example models (1 or 2 elements), the estimates are up to 0.13
# of 32 such changes. 27 of these are 0.8 to 1.1 times the error beside 8 elements; the others are
# larger, and belong to the middle of single elements.
_SMALL_CHANGE, _MAX_STEP_ERROR = 1e-4, 0.5
# In 150 runs of cantilevers, hinged beams, cranks, blades and arcs and 25 drops on foam (1 or 2
# elements), halved elements change 300 peaks of rates and accelerations by more than this. Of
# these, 2 are off by less than 1 % beside 8 times as many elements, and 262 by 0.7 times the change
# or more, the others belong to beams without material damping. Of 62 changes of 1 to 1.5 %, 7 are
# off by less than 0.5 %.
_MAX_ERROR_OF_RATES = 0.02


class RefinedRun(NamedTuple):
    """Run with more accurate beams.

    Attributes
    ----------
    run
        The run.
    exact, halved
        Names of the beams with exact strains and with halved elements.
    """

    run: RunData
    exact: tuple[str, ...]
    halved: tuple[str, ...]


def is_short(run: RunData) -> bool:
    """Return True if a run is short enough to repeat."""
    return run.trajectory.steps * run.equations.n <= _MAX_WORK


def refine_run(
    run: RunData,
    run_again: RunAgain,
    *,
    exact: Collection[str] = (),
    halved: Collection[str] = (),
) -> RefinedRun | None:
    """Repeat a short run from t = 0 with exact strains and halved elements of the named beams.

    Returns None if the run is long, no beam can be refined, or the repeated run fails. Laws of
    sampled controllers have no memory outside the coordinates; see `Controller`.

    Parameters
    ----------
    run
        The run.
    run_again
        Function that repeats the run with other equations, given a similar motion with their
        coordinates, or returns None if it fails.
    exact, halved
        Names of beams.
    """
    if not is_short(run):
        return None
    # Imported here because few runs need it, and the import slows the start of the others.
    from beamdae.equations.assembly.refined_beams import refine_beams

    start = EQUILIBRIUM if run.start.request == EQUILIBRIUM else AS_DRAWN
    refined = refine_beams(run.equations, exact=exact, halved=halved, start=start)
    if refined is None:
        return None
    equations = refined.equations
    if start == AS_DRAWN:
        first = run.trajectory.intervals[0].rows
        q, v = (refined.prolongation @ x[0] for x in (first.q, first.v))
        equations = replace(equations, q0=refined.start + q, v0=v)
    other = run_again(equations, _prolong(run.trajectory, refined))
    return None if other is None else RefinedRun(other, refined.exact, refined.halved)


def _prolong(trajectory: Trajectory, refined: RefinedBeams) -> Trajectory:
    """Return the positions and velocities of a motion in the coordinates of refined beams."""
    matrix, intervals = refined.prolongation, []
    for interval in trajectory.intervals:
        q, v, *others = interval.rows
        rows = State(refined.start + (matrix @ q.T).T, (matrix @ v.T).T, *others)
        intervals.append(replace(interval, rows=rows))
    return Trajectory(tuple(intervals))


@dataclass(frozen=True)
class RunChanges:
    """Changes of the columns of a run with more accurate beams.

    Attributes
    ----------
    run, other
        The run, and the repeated one.
    ranges, finer_ranges
        Ranges of positions and angles and peaks of other columns of the run and of the repeated
        one, by header. If the run starts in equilibrium or rotation, ranges include the drawing:
        vibrations about an equilibrium may be smaller than small errors of its deflection.
    differences
        Absolute differences of positions and angles at rows, and those of peaks (1,), by header.
        Section forces that are small along the beam in both runs are omitted.
    includes_drawing
        True if ranges include the drawing.
    """

    run: RunData
    other: RunData
    ranges: dict[str, float]
    finer_ranges: dict[str, float]
    differences: dict[str, Array]
    includes_drawing: bool

    @classmethod
    def measure(cls, run: RunData, other: RunData) -> RunChanges:
        """Return the changes in another run."""
        drawing = _observe_drawing(run)
        ranges, finer = (_measure_ranges(x, drawing) for x in (run, other))
        negligible = set.intersection(*(_find_negligible(x) for x in (run, other)))
        differences = {
            header: _subtract_rows(run, other, header)
            if _is_position(header)
            else np.array([abs(ranges[header] - finer[header])])
            for header in ranges
            if header in finer and header not in negligible
        }
        return cls(run, other, ranges, finer, differences, bool(drawing))

    @cached_property
    def scales(self) -> dict[str, float]:
        """The larger one of the two ranges or peaks of each compared column, by header."""
        return {x: max(self.ranges[x], self.finer_ranges[x]) for x in self.differences}

    @cached_property
    def errors(self) -> dict[str, float]:
        """Changes of over 1 % relative to `scales`, by header, the largest one first."""
        values = {header: (0.0, float(np.max(x))) for header, x in self.differences.items()}
        find = partial(
            find_changes,
            self.run.equations,
            values,
            self.scales,
            MIN_SHARE_AT_REST,
            mechanism=self.run._sizes_of_mechanism,
        )
        errors = remove_drift(self.run, self.other, find(), self.scales)
        return self._remove_step_errors(errors, find(min_change=_SMALL_CHANGE), self.scales)

    @cached_property
    def rate_errors(self) -> dict[str, float]:
        """Changes of `peaks_of_rates` of over 2 %, by header, the largest one first."""
        errors = find_changes_of_rates(self.run, self.other, MIN_SHARE_AT_REST)
        large = find_changes_of_rates(self.run, self.other)
        peaks = [peaks_of_rates(x._extremes_above_rounding) for x in (self.run, self.other)]
        scales = {header: max(x[header] for x in peaks) for header in errors}
        return self._remove_step_errors(errors, large, scales)

    def _remove_step_errors(
        self, errors: dict[str, float], large: Collection[str], scales: Mapping[str, float]
    ) -> dict[str, float]:
        """Return the errors that are `large` or exceed those of the time integration."""
        return {
            header: error
            for header, error in errors.items()
            if header in large
            or 0.0 < self._step_errors[header] < _MAX_STEP_ERROR * error * scales[header]
        }

    @cached_property
    def _step_errors(self) -> dict[str, float]:
        """Errors of the columns by the time integration, by header.

        They are infinite if they are unknown, and zero for columns that vary by errors only.
        """
        verification = deferred.module("verification")
        errors = np.full(len(self.run.columns), np.inf)
        with suppress(BeamdaeError):  # The second run cannot begin.
            estimate = verification.estimate_errors(self.run)
            errors = estimate[verification.RELATIVE_ERROR] * estimate[verification.HALF_RANGE]
        return dict(zip(self.run.columns, errors.tolist(), strict=True))

    def describe(
        self, doubt: BeamDoubt, run_again: RunAgain, unnamed: Collection[str] = ()
    ) -> Iterator[str]:
        """Yield a warning if there are `errors` or `rate_errors`.

        Parameters
        ----------
        doubt
            Why the run was repeated.
        run_again
            Function that repeats the run.
        unnamed
            Headers of columns that have other warnings.
        """
        errors = {header: error for header, error in self.errors.items() if header not in unnamed}
        clauses, advice = [], ""
        if errors:
            clause, advice = self._describe_largest(errors, run_again)
            clauses.append(clause)
        if self.rate_errors:
            clauses.append(describe_changes_of_rates(self.rate_errors))
        if clauses:
            remedy = doubt.remedy(find_largest_change(errors, self.rate_errors))
            yield f"{doubt.cause}: {doubt.comparison}, {', and '.join(clauses)}; {remedy}.{advice}"

    def _describe_largest(
        self, errors: Mapping[str, float], run_again: RunAgain
    ) -> tuple[str, str]:
        """Return a clause about errors, the largest one first, and advice about chaotic motions."""
        worst, *others = errors
        also = [f"{remove_unit(x)} {format_percent(errors[x])}" for x in others]
        name, size, advice = remove_unit(worst), format_percent(errors[worst]), ""
        scale = self.scales[worst]
        if _is_position(worst):
            is_large = self.differences[worst] > MAX_UNREPORTED_ERROR * scale
            since = self.run.t[int(np.argmax(is_large))]
            ratio = abs(self.finer_ranges[worst] - self.ranges[worst]) / scale
            change = format_percent(ratio) if ratio > _ROUNDED_CHANGE else "less than 0.1 %"
            what = "range from the drawing on" if self.includes_drawing else "range"
            size = (
                f"up to {size} of its {what}, by over 1 % from t = {since:.4g} s on, and its range "
                f"by {change}"
            )
            if errors[worst] > _LARGE_DIFFERENCE:
                advice = _describe_chaos(self.run, run_again, worst, scale)
        else:
            name = f"the peak of {name}"
        return f"{name} differs by {name_with_others(size, also)}", advice


def find_largest_change(errors: Mapping[str, float], rate_errors: Mapping[str, float]) -> float:
    """Return the change that decides on the number of elements that a warning recommends.

    Changes of rates are weighted such that one of 8 % counts as `LARGE_CHANGE`: elements of half
    the length may reduce it to a fourth.
    """
    weight = LARGE_CHANGE / (2.0**2 * _MAX_ERROR_OF_RATES)
    return max([0.0, *errors.values(), *(weight * x for x in rate_errors.values())])


def find_changes_of_rates(
    run: RunData, other: RunData, min_share: float = MIN_SHARE
) -> dict[str, float]:
    """Return changes of `peaks_of_rates` of over 2 % in a run with more accurate beams.

    They are relative to the larger peak, by header, the largest one first. Peaks that may be errors
    of the integration, such as those of a fixed point, are omitted, and so are those below this
    share of the largest one of their kind.
    """
    rates, finer = (peaks_of_rates(x._extremes_above_rounding) for x in (run, other))
    values = {x: (rates[x], finer[x]) for x in rates if x in finer}
    scales = {x: max(y) for x, y in values.items()}
    errors = find_changes(
        run.equations, values, scales, min_share, mechanism=run._sizes_of_mechanism
    )
    large = {header: error for header, error in errors.items() if error > _MAX_ERROR_OF_RATES}
    return remove_drift(run, other, large, scales, run.integrator.get("rtol") or 0.0)


def remove_drift(
    run: RunData,
    other: RunData,
    errors: dict[str, float],
    sizes: Mapping[str, float],
    rtol: float = 0.0,
) -> dict[str, float]:
    """Return the errors of columns that are larger than the drift of the constraints.

    Parameters
    ----------
    run, other
        The compared runs.
    errors
        Errors of columns by header.
    sizes
        Ranges or peaks of the columns, by header.
    rtol
        Tolerance of the runs, to omit other errors of the integration of rates; 0 for positions.
    """
    if not errors:
        return errors
    headers = list(errors)
    values = np.array([sizes[x] for x in headers])
    is_drift = mark_unresolved_columns(
        headers,
        values,
        values * list(errors.values()),
        run.equations.length,
        rtol,
        map(find_drift, (run, other)),
        run._sizes_of_mechanism,
        min_noise_share=0.0,
    )
    return {x: errors[x] for x, drifts in zip(headers, is_drift, strict=True) if not drifts}


def _describe_chaos(run: RunData, run_again: RunAgain, header: str, scale: float) -> str:
    """Return a sentence if the motion amplifies a small change of the start, otherwise ""."""
    e, first = run.equations, run.trajectory.intervals[0].rows
    # Changed positions would excite axial vibrations, which take many steps.
    change = _START_CHANGE * np.max(np.abs(run.v), axis=0)
    other = run_again(replace(e, q0=first.q[0], v0=first.v[0] + change), run.trajectory)
    if other is None:
        return ""
    difference = np.max(_subtract_rows(run, other, header))
    amplification = difference / (scale * _START_CHANGE)
    if not amplification > _MIN_AMPLIFICATION:
        return ""
    return (
        f" The motion is chaotic (changes of the start grow {amplification:.0e} times): compare "
        "ranges instead of values at one time."
    )


def _observe_drawing(run: RunData) -> dict[str, float]:
    """Return the columns of the drawing if the run starts in equilibrium or rotation."""
    e, first = run.equations, run.trajectory.intervals[0]
    if e.start is None or e.start.closed_q is None:
        return {}
    rest = np.zeros((1, e.n))
    state = e.start.closed_q[None], rest, rest, first.rows.lam[:1]
    (values,) = run._observe(first.times[:1], *state)
    return dict(zip(e.observed_headers, values.tolist(), strict=True))


def _measure_ranges(run: RunData, drawing: dict[str, float]) -> dict[str, float]:
    """Return ranges of positions and angles, from the drawing on, and peaks of other columns.

    Vibrations about an equilibrium may be smaller than small errors of its deflection.
    """
    extremes = run._extremes_above_rounding
    scales = scales_of_columns(extremes)
    for header in scales:
        if header in drawing and _is_position(header):
            x, drawn = extremes[header], drawing[header]
            scales[header] = max(x.max, drawn) - min(x.min, drawn)
    return scales


def _find_negligible(run: RunData) -> set[str]:
    states_at = partial(states_at_nodes, run)
    return find_negligible_columns(run.equations, run.columns.__getitem__, states_at)


def _is_position(header: str) -> bool:
    return Header.of(header).unit in UNITS_OF_POSITIONS


def _subtract_rows(run: RunData, other: RunData, header: str) -> Array:
    """Return the absolute differences of a column at the rows of both runs."""
    # An event may end one of the runs slightly earlier.
    rows = slice(min(len(run.t), len(other.t)))
    return np.abs(run.columns[header][rows] - other.columns[header][rows])
