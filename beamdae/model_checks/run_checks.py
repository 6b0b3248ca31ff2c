"""Checks of completed runs, whose warnings `Solution.warnings` lists in the order of this file.

A check is a function of a run that yields sentences. To add one, write the function in
`model_checks` and add it to `RUN_CHECKS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from beamdae import deferred
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.dependent_constraints import scaled_null_space
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import BeamdaeError, format_percent, list_first
from beamdae.model_checks.contacts import (
    deep_contact_warnings,
    impact_order_warnings,
    start_inside_warnings,
)
from beamdae.model_checks.validity_ranges import (
    names_strains,
    overrun_warnings,
    sample_positions,
    strain_warnings,
    table_range_warnings,
)
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.results.columns import (
    LIMIT,
    ColumnDict,
    Header,
    format_apart,
    largest_of_kind,
    remove_unit,
)
from beamdae.results.energy_balance import has_rounding_forces
from beamdae.results.noise import constant_limits, mark_noise
from beamdae.results.run_data import RunData
from beamdae.results.singular_positions import singularity_warnings, unbounded_warnings
from beamdae.results.step_extremes import may_have_short_peaks
from beamdae.results.trajectory import Instant

if TYPE_CHECKING:
    from beamdae.results.run_data import RunData


Array = np.ndarray

_MAX_COORDINATES = 300  # of dense matrices
_GROWTH = np.log(1e3)  # exponent in a run, from an imperfection to a deflection
_LAST_PART = 0.05  # of a run, in which a mode grows at least by a factor of e
_MAX_TRAVEL = 0.1  # of slow motions while a mode grows by a factor of e, in natural sizes
_ASYMMETRY = 1e-9  # of the stiffness of forces without a potential
# Raised for singular positions, massless points, and values that are not finite
_NOT_LINEARIZED = (BeamdaeError, ValueError)


def unstable_motion_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning if the start or the slow motion at the end of a run is unstable.

    The run contains no disturbance that would leave such a state. Models with sampled controllers,
    which may hold it, are exempt.
    """
    e, start, end = run.equations, run.trajectory.start, run.trajectory.end
    duration = end - start
    if e.mechanism is None or e.controllers or e.n > _MAX_COORDINATES or not duration > 0.0:
        return
    remedy = "add an imperfection (bd.imperfect) or a small load"
    if run.start.request == EQUILIBRIUM and (rate := _find_growth(run, start, _GROWTH / duration)):
        yield (
            "start: the equilibrium is unstable, and the smallest disturbance leaves it as "
            f"exp({rate:.3g} t); start from other positions, or {remedy}."
        )
        return
    span, state = _LAST_PART * duration, run.trajectory.at(np.array([end]))[1]
    travel = (span * np.abs(state.v[0]) + span**2 * np.abs(state.a[0])) / e.position_scales
    if np.max(travel) > _MAX_TRAVEL:
        return
    if rate := _find_growth(run, end, 1.0 / span):
        yield (
            f"run: at t = {end:.4g} s, the motion is slow but unstable, and the smallest "
            f"disturbance leaves it as exp({rate:.3g} t); {remedy}."
        )


def _find_growth(run: RunData, t: float, min_rate: float) -> float:
    """Return the largest growth rate [1/s] above `min_rate` about a state of the run, or 0."""
    # Imported here, because few runs start in an equilibrium or end in a slow motion.
    from beamdae.equations.formulations.tangents import compute_tangent

    e, trajectory, times = run.equations, run.trajectory, np.array([t])
    (time,), state = trajectory.at(times)
    interval = trajectory.intervals[int(trajectory.interval_index(times)[0])]
    active, lam = interval.active_equations(e), state.lam
    if interval.configuration is not None:
        lam = interval.configuration.select_multipliers(lam)
    state = type(state)(*(x[0] for x in state._replace(lam=lam)))
    with np.errstate(all="ignore"), suppress(*_NOT_LINEARIZED):
        tangent = compute_tangent(active, time, state)
        basis = scaled_null_space(tangent.acceleration_jacobian(active), active.position_scales)
        stiffness = basis.T @ (tangent.stiffness @ basis)
        total = tangent.stiffness + min_rate * tangent.damping + min_rate**2 * tangent.mass
        asymmetry = np.max(np.abs(stiffness - stiffness.T), initial=0.0)
        has_potential = asymmetry <= _ASYMMETRY * np.max(np.abs(stiffness), initial=0.0)
        projected = basis.T @ (total @ basis)
        if has_potential and np.all(np.linalg.eigvalsh(projected + projected.T) > 0.0):
            return 0.0
        analysis = deferred.module("analysis.linear_dynamics.natural_modes")
        about = Instant(time, state, interval.configuration)
        rates = analysis.compute_modes(e, about, None, assessed=0).growth_rates
        return float(np.max(rates[rates > min_rate], initial=0.0))
    return 0.0


_MIN_ROWS = 3  # runs with fewer rows are not curves
_MIN_SHARE = 1e-3  # of the largest half range of columns of this kind; smaller ones do not matter
# Units of positions, velocities and works, which abrupt forces change gradually.
_GRADUAL_UNITS = ("m", "rad", "m/s", "rad/s", "J")


@dataclass(frozen=True)
class MissedPeak:
    """Value of a column between output rows that these miss.

    Attributes
    ----------
    column
        Header of the column.
    time
        Time of the value [s].
    side
        "smallest" or "largest".
    value, row_value
        The value, and the nearest one of the rows, in the unit of the column.
    half_range
        Half the range of the column, including the steps.
    error
        Larger one of the difference of the extremes, relative to half the range, and of the root
        mean square of the distance from the neighboring rows, relative to the deviation [-].
    importance
        Difference of the values relative to the largest half range of the columns of this kind [-].
    is_extreme
        True if the value is the extreme of the run, otherwise that of a vibration.
    """

    column: str
    time: float
    side: str
    value: float
    row_value: float
    half_range: float
    error: float
    importance: float
    is_extreme: bool


def find_missed_peaks(run: RunData) -> ColumnDict:
    """Return the largest miss of each column that the rows do not show within 4 %, by header.

    The rows of a column show neither an extreme nor a vibration between them if the extreme of the
    steps exceeds that of the rows by 4 % of half the range, or the steps are outside the range of
    the two neighboring rows by a root mean square of 4 % of the deviation of the column. Columns
    that vary by errors only, or are small beside others of the same kind, are omitted, and so are
    lower extremes of magnitudes.
    """
    e, steps = run.equations, run._step_measures
    if run._is_at_rest or not run.columns:
        return ColumnDict()
    headers, rows = e.observed_headers, np.array(list(run.columns.values()))
    at_rows = np.stack([rows.min(axis=1), rows.max(axis=1)])
    half_range = 0.5 * (steps.values[1] - steps.values[0])
    misses = np.stack([at_rows[0] - steps.values[0], steps.values[1] - at_rows[1]])
    misses[0, np.isin(headers, run._magnitudes)] = 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        of_extremes = np.max(misses, axis=0) / half_range
        errors = np.fmax(of_extremes, steps.excess / steps.deviation)
    is_missed = (errors > LIMIT) & np.isin(headers, list(run.step_extremes))
    largest = largest_of_kind(headers, half_range, e.length)
    is_missed &= half_range > _MIN_SHARE * largest
    rtol = run.integrator.get("rtol") or 0.0
    is_missed &= half_range > constant_limits(headers, steps.values, e.length, rtol)
    if is_missed.any():
        in_doubt = np.where(is_missed, half_range, 0.0)
        is_missed &= ~mark_noise(run, steps.values, half_range, in_doubt)
    peaks = {}
    for k in np.flatnonzero(is_missed).tolist():
        is_extreme, side = bool(of_extremes[k] > LIMIT), int(misses[1, k] > misses[0, k])
        place = steps.times[side, k], steps.values[side, k], at_rows[side, k]
        if not is_extreme:
            place = steps.excess_times[k], steps.excess_values[k], steps.excess_rows[k]
        time, value, row_value = map(float, place)
        peaks[headers[k]] = MissedPeak(
            headers[k],
            time,
            "largest" if value > row_value else "smallest",
            value,
            row_value,
            half_range=float(half_range[k]),
            error=float(errors[k]),
            importance=abs(value - row_value) / float(largest[k]),
            is_extreme=is_extreme,
        )
    return ColumnDict(peaks)


def coarse_row_warnings(run: RunData) -> Iterator[str]:
    """Yield one warning about what the rows of a run do not show.

    The column whose miss is largest, relative to the largest half range of its kind, comes first.
    Of long runs that store only some of their steps, peaks are unknown where forces may be short.
    """
    e = run.equations
    peaks = list(run.missed_peaks.values()) if len(run.t) >= _MIN_ROWS else []
    unknown = []
    if not run.trajectory.stores_all_steps and may_have_short_peaks(e):
        units = {header: Header.of(header).unit for header in e.observed_headers}
        unknown = [remove_unit(x) for x, unit in units.items() if unit not in _GRADUAL_UNITS]
    if unknown:
        remedy = (
            "this long run stores only some of its steps, so larger peaks between the output rows "
            "are unknown; reduce output_step= or the end time, or use "
            "bd.simulate(..., keep_steps=True)"
        )
    else:
        remedy = "tables of extremes and step_extremes include these values; curves show them with "
        remedy += "a smaller output_step"
    if unknown and not peaks:
        yield f"{list_first(unknown)}: {remedy}."
    if not peaks:
        return
    worst, *others = sorted(peaks, key=lambda x: -x.importance)
    value, row_value = format_apart(worst.column, worst.value, worst.row_value)
    names = list_first([remove_unit(x.column) for x in others])
    missed, reach = f"its {worst.side} value", "and reach only"
    if not worst.is_extreme:
        missed, reach = "values between them", "where they reach only"
    yield (
        f"{remove_unit(worst.column)}: the output rows miss {missed}, {value} at "
        f"t = {worst.time:.6g} s, {reach} {row_value}{f', also in {names}' if names else ''}; "
        f"{remedy}."
    )


Check = Callable[[RunData], Iterable[str]]

_MAX_ENERGY_IMBALANCE = 0.02  # relative to the energy exchanged
# Places in intervals at which slopes of laws are evaluated, and their smallest jump relative to the
# largest slope
_PLACES, _MIN_JUMP = np.array([0.0, 1.0 / 3.0, 1.0]), 1e-6


def _start(run: RunData) -> Iterator[str]:
    """Yield warnings found by building and starting the model."""
    yield from run.equations.build_warnings
    yield from run.resume_warnings
    yield from filter(None, (run.start.warning,))
    first = run.trajectory.intervals[0]
    # A resumed run may start in the middle of an impact.
    if run.trajectory.start == 0.0:
        active, state = first.active_equations(run.equations), State(*(x[0] for x in first.rows))
        yield from start_inside_warnings(run.equations, active, first.times[0], state)


def _balance(run: RunData) -> Iterator[str]:
    ledger = run._energy_ledger
    ratio = ledger.quality.energy_imbalance
    # `not <=` rather than `>`, so that an imbalance of nan is reported.
    if not ratio <= _MAX_ENERGY_IMBALANCE and not has_rounding_forces(
        run.equations, run.trajectory, ledger.largest_force
    ):
        yield (
            f"energy: the energy imbalance is {format_percent(ratio, 3)} of the energy exchanged, "
            "so velocities and forces may be wrong by tens of percent; reduce rtol or the step by "
            "a factor of ten, and check laws for jumps and for loads that become infinite."
        )


def _columns(run: RunData) -> Iterator[str]:
    """Yield a warning per observed column that is not finite where reactions are bounded."""
    if all(np.isfinite(x).all() for x in run.columns.values()):
        return
    is_unbounded = np.isnan(run.lam).any(axis=1)
    for name, values in run.columns.items():
        (rows,) = np.nonzero(~(np.isfinite(values) | is_unbounded))
        if len(rows):
            yield (
                f"{name}: this column is not finite at {len(rows)} of {len(run.t)} "
                f"times, first at t = {run.t[rows[0]]:.6g} s; check the observable and "
                "the model for very large or very small values."
            )


def _singular_positions(run: RunData) -> Iterator[str]:
    yield from singularity_warnings(run.singular_positions)
    yield from unbounded_warnings(run.equations.lam_names, run.trajectory)


def _velocity_jumps(run: RunData) -> Iterator[str]:
    """Yield a warning about each driver whose law makes velocities jump.

    The force that changes a velocity at once is infinite for an instant. The energy balance
    contains its work, but reactions, powers and their peaks do not contain it.
    """
    e, intervals = run.equations, run.trajectory.intervals
    if e.mechanism is None or len(intervals) == 1:
        return
    evaluator, still = StateEvaluator(e), np.zeros(e.n)
    # Rates of the constraints of bodies at rest: those of the laws.
    rates = np.array(
        [
            [
                evaluator.constraint_levels(np.array([t, x.branch]), x.rows.q[0], still)[1]
                for t in x.nodes[0] + _PLACES * (x.nodes[-1] - x.nodes[0])
            ]
            for x in intervals
        ]
    )
    jumps = np.abs(rates[1:, 0] - rates[:-1, -1]) > _MIN_JUMP * np.max(np.abs(rates), axis=(0, 1))
    times = np.array([x.nodes[0] for x in intervals[1:]])
    for k in np.flatnonzero(jumps.any(axis=0)):
        first, *others = times[jumps[:, k]]
        number = f"{len(others) + 1} times, first " if others else ""
        yield (
            f"{e.lam_names[k].rpartition('.')[0]}: the slope of its law jumps {number}at "
            f"t = {first:.6g} s, so that velocities change at once; reactions and powers do not "
            "contain the infinite forces of these instants: use a law with a continuous slope."
        )


def _strains(run: RunData) -> tuple[str, ...]:
    cache = vars(run)
    if "_strain_warnings" not in cache:
        positions = sample_positions(run.trajectory)
        cache["_strain_warnings"] = tuple(strain_warnings(run.equations, positions))
    sentences: tuple[str, ...] = cache["_strain_warnings"]
    return sentences


def _coarse_rows(run: RunData) -> Iterator[str]:
    # Peaks of a meaningless deformation are meaningless, too.
    yield from () if _strains(run) else coarse_row_warnings(run)


# Warnings about peaks and vibrations that the output rows do not show.
ROW_CHECKS: tuple[Check, ...] = (_coarse_rows,)

RUN_CHECKS: tuple[Check, ...] = (
    # Causes of errors come first: of the model and the start, ...
    _start,
    table_range_warnings,
    unstable_motion_warnings,
    # ... the motion and the deformation, ...
    _balance,
    _columns,
    _singular_positions,
    lambda run: () if names_strains(run.status) else _strains(run),
    overrun_warnings,
    # ... missed extremes, ...
    *ROW_CHECKS,
    # ... and single forces.
    _velocity_jumps,
    deep_contact_warnings,
    impact_order_warnings,
)
