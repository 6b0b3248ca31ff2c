"""Checks of completed runs, whose warnings `Solution.warnings` lists in the order of this file.

A check is a function of a run that yields sentences. To add one, write the function in
`results.diagnostics` and add it to `RUN_CHECKS`: by `_of_motion` if it reads the equations and the
steps, and by a function of the run in this module if it reads more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from typing import TypeVar

import numpy as np

from beamdae import deferred
from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.part_warnings import (
    MotionSamples,
    idle_part_warnings,
    start_inside_warnings,
    supplied_energy_warnings,
    unguided_driver_warnings,
)
from beamdae.errors import BeamdaeError, merge_parts
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.results.columns import ColumnDict
from beamdae.results.diagnostics.contacts.deep_contacts import (
    deep_contact_warnings,
    soft_contact_warnings,
)
from beamdae.results.diagnostics.contacts.elastic_bounces import elastic_bounce_warnings
from beamdae.results.diagnostics.contacts.hard_impacts import hard_impact_warnings
from beamdae.results.diagnostics.contacts.impact_speeds import impact_speed_warnings
from beamdae.results.diagnostics.contacts.impacts import impact_warnings
from beamdae.results.diagnostics.contacts.slow_sliding import slow_sliding_warnings
from beamdae.results.diagnostics.contacts.untouched_contacts import (
    fallen_contact_warnings,
    untouched_contact_warnings,
)
from beamdae.results.diagnostics.growing_loops import growing_loop_warnings
from beamdae.results.diagnostics.meshes.beam_ranges import sample_positions, strain_warnings
from beamdae.results.diagnostics.meshes.element_errors import (
    ElementErrors,
    compare_few_elements,
    instant_warnings,
)
from beamdae.results.diagnostics.meshes.fast_loads import fast_load_warnings
from beamdae.results.diagnostics.meshes.forced_vibrations import examine_vibrations
from beamdae.results.diagnostics.meshes.long_elements import long_element_warnings
from beamdae.results.diagnostics.meshes.mesh_errors import (
    MeshErrors,
    find_mesh_errors,
    states_at_nodes,
)
from beamdae.results.diagnostics.meshes.moving_loads import moving_load_warnings
from beamdae.results.diagnostics.meshes.refined_runs import RunAgain
from beamdae.results.diagnostics.meshes.snaps import snap_warnings
from beamdae.results.diagnostics.meshes.strain_errors import strain_error_warnings
from beamdae.results.diagnostics.quality_warnings import balance_warnings, column_warnings
from beamdae.results.diagnostics.rare_samples import rare_sample_warnings
from beamdae.results.diagnostics.resolution.coarse_rows import coarse_row_warnings
from beamdae.results.diagnostics.resolution.driven_reactions import driven_reaction_warnings
from beamdae.results.diagnostics.resolution.missed_parts import missed_part_warnings
from beamdae.results.diagnostics.resolution.missed_peaks import (
    StepExtremes,
    damping_peak_warnings,
    list_unknown_peaks,
    missed_peak_warnings,
    remove_minor_peaks,
    select_peaks_of_damping,
)
from beamdae.results.diagnostics.resolution.small_motions import small_motion_warnings
from beamdae.results.diagnostics.resolution.sudden_vibrations import sudden_vibration_warnings
from beamdae.results.diagnostics.resolution.suppressed_growth import suppressed_growth_warnings
from beamdae.results.diagnostics.resolution.unresolved_forces import unresolved_force_warnings
from beamdae.results.diagnostics.rest import has_rounding_forces, is_motionless
from beamdae.results.diagnostics.rounding_limits import rounding_limits
from beamdae.results.diagnostics.saturated_commands import saturated_command_warnings
from beamdae.results.diagnostics.singular_positions import (
    singularity_warnings,
    unbounded_warnings,
)
from beamdae.results.diagnostics.start_transients import start_transient_warnings
from beamdae.results.diagnostics.suspected_errors import SuspectedError
from beamdae.results.diagnostics.table_ranges import (
    table_range_warnings,
    unentered_table_warnings,
)
from beamdae.results.diagnostics.unconnected_bodies import (
    unconnected_body_warnings,
    undriven_body_warnings,
)
from beamdae.results.diagnostics.unstable_symmetry import unstable_symmetry_warnings
from beamdae.results.diagnostics.velocity_jumps import velocity_jump_warnings
from beamdae.results.run_data import RunData, find_drift
from beamdae.results.trajectory import Trajectory

Check = Callable[[RunData], Iterable[str]]
T = TypeVar("T")

# Causes of errors for which checks repeat runs, see `skip_error_estimates`.
STEPS, BEAMS = "steps", "beams"
_estimated_errors: ContextVar[frozenset[str]] = ContextVar(
    "estimated_errors", default=frozenset((STEPS, BEAMS))
)
_POWER_SAMPLES = 201  # times at which the power of user-written damping is evaluated


def _once_a_run(evaluate: Callable[[RunData], T]) -> Callable[[RunData], T]:
    """Return the function with a cache in the attributes of the run, for results of two checks."""

    def evaluate_once(run: RunData) -> T:
        cache, name = vars(run), f"_result_of{evaluate.__name__}"
        if name not in cache:
            cache[name] = evaluate(run)
        result: T = cache[name]
        return result

    return evaluate_once


def _of_motion(check: Callable[[EquationsOfMotion, Trajectory], Iterable[str]]) -> Check:
    return lambda run: check(run.equations, run.trajectory)


def _of_complete_run(check: Callable[[EquationsOfMotion, Trajectory], Iterable[str]]) -> Check:
    """Return the check for runs that begin at t = 0 and reach their planned end.

    In a run that was stopped early, or resumed, parts may act later, or have acted before.
    """

    def check_run(run: RunData) -> Iterable[str]:
        return check(run.equations, run.trajectory) if _is_complete(run) else ()

    return check_run


def _is_complete(run: RunData) -> bool:
    start, end = run.trajectory.start, run.trajectory.end
    return start == 0.0 and bool(end >= run.model.get("t_end", end))


def _growing_loops(run: RunData) -> Iterable[str]:
    # The reason of a run that has stopped names an unstable loop already.
    has_stopped = run.status.kind in ("failed", "limited")
    return () if has_stopped else growing_loop_warnings(run.equations, run.trajectory)


def _balance(run: RunData) -> Iterable[str]:
    ledger = run._energy_ledger
    if has_rounding_forces(run.equations, run.trajectory, ledger.force.scale):
        return ()
    return balance_warnings(run.equations, ledger)


def _columns(run: RunData) -> Iterable[str]:
    if all(np.isfinite(x).all() for x in run.columns.values()):
        return ()
    return column_warnings(run.columns, run.t, np.isnan(run.lam).any(axis=1))


def _singular_positions(run: RunData) -> Iterable[str]:
    yield from singularity_warnings(run.singular_positions)
    yield from unbounded_warnings(run.equations.lam_names, run.trajectory)


@_once_a_run
def _strains(run: RunData) -> tuple[str, ...]:
    positions = partial(sample_positions, run.trajectory)
    return tuple(strain_warnings(run.equations, run.validity, positions))


def find_suspected_errors(run: RunData) -> Iterator[SuspectedError]:
    """Yield the warnings of a run that an estimate of the errors of columns may exclude."""
    yield from small_motion_warnings(
        run.equations, run.trajectory, run.step_extremes, run.integrator
    )
    if not is_motionless(run.equations, run.trajectory):
        yield from sudden_vibration_warnings(
            run.equations,
            run.trajectory,
            run._extremes_above_rounding,
            run._observe,
            run.integrator,
        )


def _suspected_errors(run: RunData) -> Iterator[str]:
    can_repeat = run.made_by is not None and run.status.success
    is_repeated = can_repeat and STEPS in _estimated_errors.get()
    for suspected in find_suspected_errors(run):
        is_wrong = False
        if is_repeated:
            with suppress(BeamdaeError):  # The second run cannot begin.
                is_wrong = deferred.module("verification").is_refuted(run, suspected)
        if not is_wrong:
            yield suspected.sentence


@contextmanager
def skip_error_estimates(*causes: str) -> Iterator[None]:
    """Within the context, checks do not repeat runs with shorter steps or more accurate beams.

    For callers that estimate the errors themselves, and for runs that belong to an estimate.
    `causes` of errors are STEPS and BEAMS; they default to both.
    """
    skipped = causes or (STEPS, BEAMS)
    token = _estimated_errors.set(_estimated_errors.get().difference(skipped))
    try:
        yield
    finally:
        _estimated_errors.reset(token)


def _step_errors(run: RunData) -> Iterator[str]:
    errors = _estimate_step_errors(run)
    warning = errors and deferred.module("verification").accuracy_warning(run, errors)
    if warning:
        yield warning


def _estimate_step_errors(run: RunData) -> Mapping[str, np.ndarray] | None:
    """Return the errors of the columns due to fixed steps, or None if there is no estimate."""
    # Runs that were loaded from a file do not contain their integrator.
    can_repeat = run.made_by is not None and run._has_fixed_steps and run.status.success
    is_estimated = STEPS in _estimated_errors.get()
    if not (is_estimated and can_repeat and run.columns) or run._is_at_rest:
        return None
    verification = deferred.module("verification")
    with suppress(BeamdaeError):  # The second run cannot begin.
        return verification.estimate_errors(run)
    return None


def _repeat_with_beams(run: RunData) -> RunAgain | None:
    """Return a function that repeats a run with other equations; None if it cannot be repeated."""
    # Runs that were loaded from a file do not contain their integrator.
    can_repeat = run.made_by is not None and run.status.success and run.trajectory.start == 0.0
    if not (BEAMS in _estimated_errors.get() and can_repeat and run.columns):
        return None

    def run_again(equations: EquationsOfMotion, motion: Trajectory) -> RunData | None:
        other: RunData | None = None
        verification = deferred.module("verification")
        with suppress(BeamdaeError):  # The second run cannot begin.
            other = verification.run_again(run, run.made_by, None, equations, motion)
        return other

    return run_again


def _strain_errors(run: RunData) -> Iterable[str]:
    return strain_error_warnings(run, _repeat_with_beams(run))


@_once_a_run
def _find_element_errors(run: RunData) -> ElementErrors:
    """Return the comparison of a run with halved elements."""
    run_again = None if run._is_at_rest else _repeat_with_beams(run)
    if run_again is None:
        return ElementErrors()
    of_snaps = tuple(snap_warnings(run, run_again))
    if of_snaps:
        beams = beams_of(run.equations.mechanism)
        return ElementErrors(tuple(x.name for x in beams), warnings=of_snaps)
    return compare_few_elements(
        run, run_again, _is_complete(run), lambda: _find_mesh_errors(run).columns
    )


def _uncompared_extremes(run: RunData, extremes: ColumnDict) -> dict[str, StepExtremes]:
    """Return the extremes of columns whose errors by elements are to be estimated, by header."""
    known = _find_element_errors(run).columns
    return {header: x for header, x in extremes.items() if header not in known}


def _suppressed_growth(run: RunData) -> Iterable[str]:
    if run._is_at_rest or not run.status.success:
        return ()
    return suppressed_growth_warnings(run.equations, run.trajectory, run.integrator)


def _hard_impacts(run: RunData) -> Iterable[str]:
    are_compared = run._hard_impacts and _find_element_errors(run).has_hard_impacts
    return () if are_compared else hard_impact_warnings(run._hard_impacts)


def _has_wrong_forces(run: RunData) -> bool:
    return any(not x.column for x in run._hard_impacts)


def _missed_peaks(run: RunData) -> Iterable[str]:
    if _strains(run):
        return  # peaks of a meaningless deformation
    peaks, jumps = run.missed_peaks, [x.t for x in run.event_records if x.energy_lost > 0.0]
    damping = max((x.section.at(0.0).damping for x in beams_of(run.equations.mechanism)), default=0)
    observe_at = partial(_observe_columns, run)
    of_damping = select_peaks_of_damping(peaks, jumps, damping, run.trajectory.end, observe_at)
    mechanism = run.equations.mechanism
    events = () if mechanism is None else mechanism.events
    has_impacts = any(select_impacts(x.do) for x in events)
    yield from damping_peak_warnings(of_damping, has_impacts)
    known = {x.peak for x in of_damping}
    others = {name: peak for name, peak in peaks.items() if peak not in known}
    others = remove_minor_peaks(others, run.step_extremes, run.equations.length)
    unknown = list_unknown_peaks(run.equations, run.trajectory)
    yield from missed_peak_warnings(others, len(run.t), not _has_wrong_forces(run), unknown)


def _observe_columns(run: RunData, times: np.ndarray) -> dict[str, np.ndarray]:
    """Return the observed columns at ascending times [s], by header."""
    return dict(zip(run.equations.observed_headers, run._observe_at(times).T, strict=True))


def _coarse_rows(run: RunData) -> Iterable[str]:
    # Long runs store only the rows, and few steps between them.
    if run._is_at_rest or not run.trajectory.stores_all_steps or _strains(run):
        return ()
    coarse = coarse_row_warnings(
        run.t,
        run.columns,
        run._observe_at,
        run.equations.length,
        run.integrator.get("rtol") or 0.0,
        lambda: find_drift(run),
        rounding_limits(run.equations, list(run.columns), run.trajectory.mean_step),
        run._sizes_of_mechanism,
    )
    return tuple(coarse) or _missed_parts(run)


def _missed_parts(run: RunData) -> Iterable[str]:
    # Elements that do not resolve an impact vibrate faster than any rows show.
    missed = {} if _has_wrong_forces(run) else run._missed_parts
    return missed_part_warnings(
        missed,
        {header: run.step_extremes[header].half_range for header in missed},
        run.t,
        np.concatenate([x.t for x in run.trajectory.intervals]),
        partial(_observe_columns, run),
    )


def _impacts(run: RunData) -> Iterable[str]:
    return impact_warnings(run.equations, run.trajectory, run.event_records)


def _velocity_jumps(run: RunData) -> Iterable[str]:
    return velocity_jump_warnings(run.equations, run.trajectory, run.event_records)


def _unresolved_forces(run: RunData) -> Iterable[str]:
    has_fixed_steps = run._has_fixed_steps
    return unresolved_force_warnings(run.equations, run.trajectory) if has_fixed_steps else ()


def _driven_reactions(run: RunData) -> Iterable[str]:
    if run._is_at_rest:
        return ()
    return driven_reaction_warnings(
        run.equations, run.trajectory, run.columns, run.t, run._observe, run.integrator
    )


def _untouched_contacts(run: RunData) -> Iterable[str]:
    if not _is_complete(run):
        return ()
    force = run._energy_ledger.force.scale
    return untouched_contact_warnings(run.equations, run.trajectory, force)


@_once_a_run
def _find_mesh_errors(run: RunData) -> MeshErrors:
    """Return the stresses, strains and section forces that differ from those by the loads."""
    # Section forces in equilibrium with accelerations that vibrate from step to step are wrong.
    errors = _estimate_step_errors(run)
    verification = deferred.module("verification")
    wrong = {} if errors is None else verification.find_excessive_errors(run, errors)
    states_at, column_of = partial(states_at_nodes, run), run.columns.__getitem__
    return find_mesh_errors(run.equations, column_of, states_at, True, set(wrong))


def _mesh_errors(run: RunData) -> Iterable[str]:
    return _find_mesh_errors(run).warnings


def _few_elements(run: RunData) -> Iterable[str]:
    return _find_element_errors(run).warnings


def _coarse_elements(run: RunData) -> Iterable[str]:
    if run._is_at_rest:
        return ()
    return instant_warnings(run, _repeat_with_beams(run), _find_element_errors(run).beams)


def _long_elements(run: RunData) -> Iterator[str]:
    if run._is_at_rest:
        return
    motion = run.equations, run.trajectory, _uncompared_extremes(run, run.step_extremes)
    examined = dict(examine_vibrations(*motion, run._observe))
    yield from merge_parts((name, *x) for name, x in examined.items() if x[1])
    yield from long_element_warnings(
        *motion, run._observe_at, lambda: run._energy_ledger.is_lightly_damped, examined
    )


def _fast_loads(run: RunData) -> Iterable[str]:
    if run._is_at_rest:
        return ()
    extremes = _uncompared_extremes(run, run._extremes_above_rounding)
    return fast_load_warnings(run.equations, run.trajectory, extremes)


def _start_transients(run: RunData) -> Iterable[str]:
    extremes = run._extremes_above_rounding
    return start_transient_warnings(run.equations, run.trajectory, extremes, run._observe)


def _resumed_run(run: RunData) -> Iterable[str]:
    return run.resume_warnings


def _start_changes(run: RunData) -> Iterable[str]:
    return filter(None, (run.start.warning,))


def _unstable_path(run: RunData) -> Iterable[str]:
    if run.start.request == EQUILIBRIUM:
        statics = deferred.module("analysis.statics.start_stability")
        of_start = statics.describe_unstable_start(run.equations, run.trajectory.start)
        if of_start:
            return (of_start,)
    largest_force = run._energy_ledger.force.scale
    return unstable_symmetry_warnings(run.equations, run.trajectory, largest_force)


def _idle_parts(run: RunData) -> Iterable[str]:
    start, end = run.trajectory.start, run.trajectory.end
    # A run that was stopped early does not show which parts act later.
    return idle_part_warnings(run.equations, start, run.model.get("t_end", end))


def _unguided_drivers(run: RunData) -> Iterable[str]:
    first, duration = run.trajectory.intervals[0], run.trajectory.end - run.trajectory.start
    if not duration > 0.0:
        return ()
    return unguided_driver_warnings(run.equations, first.times[0], first.state.q[0], duration)


def _parts_inside_surfaces(run: RunData) -> Iterable[str]:
    if run.trajectory.start != 0.0:
        # A resumed run may start in the middle of an impact.
        return ()
    first = run.trajectory.intervals[0]
    active, state = first.active_equations(run.equations), State(*(x[0] for x in first.rows))
    time = np.array([first.t[0], first.branch])
    inside = tuple(start_inside_warnings(run.equations, active, time, state))
    if inside or not _is_complete(run):
        return inside
    return fallen_contact_warnings(run.equations, run.trajectory)


def _supplied_energy(run: RunData) -> Iterable[str]:
    start, end = run.trajectory.start, run.trajectory.end

    def sample_motion() -> MotionSamples:
        times, states = run.trajectory.at(np.linspace(start, end, _POWER_SAMPLES))
        return MotionSamples(times, states.q, states.v, run._energy_ledger.energy.scale)

    return supplied_energy_warnings(run.equations, sample_motion) if end > start else ()


def _built_model(run: RunData) -> Iterable[str]:
    return run.equations.build_warnings


# Warnings about peaks and vibrations that the output rows do not show.
ROW_CHECKS: tuple[Check, ...] = (_missed_peaks, _coarse_rows)

# Warnings about waves after fast changes of laws.
FAST_LOADS: Check = _fast_loads

# Warnings about motions and reactions that are wrong by the elements of beams.
ELEMENT_CHECKS: tuple[Check, ...] = (_few_elements, _coarse_elements, _long_elements)

RUN_CHECKS: tuple[Check, ...] = (
    # Causes of errors come first: of the model and the start, ...
    _built_model,
    _of_motion(table_range_warnings),
    _of_complete_run(unentered_table_warnings),
    _resumed_run,
    _start_changes,
    _parts_inside_surfaces,
    _of_complete_run(unconnected_body_warnings),
    _of_complete_run(undriven_body_warnings),
    _unguided_drivers,
    _supplied_energy,
    # ... and of unstable loops.
    _growing_loops,
    _of_motion(saturated_command_warnings),
    _of_complete_run(rare_sample_warnings),
    # The motion and the deformation.
    _balance,
    _columns,
    _singular_positions,
    _strains,
    _strain_errors,
    _step_errors,
    _suspected_errors,
    _suppressed_growth,
    _hard_impacts,
    # Missed extremes.
    *ROW_CHECKS,
    # Single forces and columns.
    _impacts,
    _velocity_jumps,
    _unresolved_forces,
    _driven_reactions,
    _of_motion(slow_sliding_warnings),
    _of_motion(impact_speed_warnings),
    _of_motion(elastic_bounce_warnings),
    _of_motion(deep_contact_warnings),
    _of_motion(soft_contact_warnings),
    _untouched_contacts,
    _mesh_errors,
    *ELEMENT_CHECKS,
    FAST_LOADS,
    _of_motion(moving_load_warnings),
    # Remarks on the start and on parts without effect.
    _start_transients,
    _unstable_path,
    _idle_parts,
)
