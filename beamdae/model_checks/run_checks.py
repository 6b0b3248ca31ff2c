"""Checks of completed runs, whose warnings `Solution.warnings` lists in the order of this file.

A check is a function of a run that yields sentences. To add one, write the function in
`model_checks` and add it to `RUN_CHECKS`: by `_of_motion` if it reads the equations and the
steps, and by a function of the run in this module if it reads more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import chain, islice
from typing import TypeVar

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.part_warnings import (
    MotionSamples,
    idle_part_warnings,
    start_inside_warnings,
    supplied_energy_warnings,
    unguided_driver_warnings,
)
from beamdae.model_checks.coarse_rows import coarse_row_warnings
from beamdae.model_checks.contacts import (
    deep_contact_warnings,
    impact_speed_warnings,
    untouched_contact_warnings,
)
from beamdae.model_checks.growing_modes import growing_mode_warnings, unstable_start_warnings
from beamdae.model_checks.impacts import impact_warnings
from beamdae.model_checks.quality_warnings import balance_warnings, column_warnings
from beamdae.model_checks.rare_samples import rare_sample_warnings
from beamdae.model_checks.saturated_commands import saturated_command_warnings
from beamdae.model_checks.sliding_overrun import overrun_warnings
from beamdae.model_checks.strain_limits import sample_positions, strain_warnings
from beamdae.model_checks.table_ranges import table_range_warnings
from beamdae.model_checks.unconnected_bodies import idle_body_warnings
from beamdae.model_checks.velocity_jumps import velocity_jump_warnings
from beamdae.parts.mechanism import EQUILIBRIUM
from beamdae.results.rest import has_rounding_forces
from beamdae.results.run_data import RunData
from beamdae.results.singular_positions import (
    singularity_warnings,
    unbounded_warnings,
)
from beamdae.results.trajectory import Trajectory

Check = Callable[[RunData], Iterable[str]]
T = TypeVar("T")

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


def _table_ranges(run: RunData) -> Iterable[str]:
    return table_range_warnings(run.equations, run.trajectory, _is_complete(run))


def _growing_modes(run: RunData) -> Iterable[str]:
    motion, force = (run.equations, run.trajectory), run._energy_ledger.force.scale
    start = unstable_start_warnings(*motion) if run.start.request == EQUILIBRIUM else ()
    modes = growing_mode_warnings(*motion, force)
    # Few modes are named twice: the first one is the cause.
    return islice(chain(start, modes), 1)


def _balance(run: RunData) -> Iterable[str]:
    ledger = run._energy_ledger
    if has_rounding_forces(run.equations, run.trajectory, ledger.force.scale):
        return ()
    return balance_warnings(ledger)


def _columns(run: RunData) -> Iterable[str]:
    if all(np.isfinite(x).all() for x in run.columns.values()):
        return ()
    return column_warnings(run.columns, run.t, np.isnan(run.lam).any(axis=1))


def _singular_positions(run: RunData) -> Iterable[str]:
    yield from singularity_warnings(run.singular_positions)
    yield from unbounded_warnings(run.equations.lam_names, run.trajectory)


@_once_a_run
def _strains(run: RunData) -> tuple[str, ...]:
    return tuple(strain_warnings(run.equations, sample_positions(run.trajectory)))


def _coarse_rows(run: RunData) -> Iterable[str]:
    # Peaks of a meaningless deformation are meaningless, too.
    return () if _strains(run) else coarse_row_warnings(run)


def _impacts(run: RunData) -> Iterable[str]:
    return impact_warnings(run.equations, run.trajectory, run.event_records)


def _resumed_run(run: RunData) -> Iterable[str]:
    return run.resume_warnings


def _start_changes(run: RunData) -> Iterable[str]:
    return filter(None, (run.start.warning,))


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
    return start_inside_warnings(run.equations, active, first.times[0], state)


def _supplied_energy(run: RunData) -> Iterable[str]:
    start, end = run.trajectory.start, run.trajectory.end

    def sample_motion() -> MotionSamples:
        times, states = run.trajectory.at(np.linspace(start, end, _POWER_SAMPLES))
        return MotionSamples(times, states.q, states.v, run._energy_ledger.energy.scale)

    return supplied_energy_warnings(run.equations, sample_motion) if end > start else ()


def _built_model(run: RunData) -> Iterable[str]:
    return run.equations.build_warnings


# Warnings about peaks and vibrations that the output rows do not show.
ROW_CHECKS: tuple[Check, ...] = (_coarse_rows,)

RUN_CHECKS: tuple[Check, ...] = (
    # Causes of errors come first: of the model and the start, ...
    _built_model,
    _table_ranges,
    _resumed_run,
    _start_changes,
    _parts_inside_surfaces,
    _of_complete_run(idle_body_warnings),
    _unguided_drivers,
    _supplied_energy,
    # ... and modes that grow.
    _growing_modes,
    _of_motion(saturated_command_warnings),
    _of_complete_run(rare_sample_warnings),
    # The motion and the deformation.
    _balance,
    _columns,
    _singular_positions,
    _strains,
    # Missed extremes.
    *ROW_CHECKS,
    # Single forces and columns.
    _impacts,
    _of_motion(velocity_jump_warnings),
    _of_motion(impact_speed_warnings),
    _of_motion(deep_contact_warnings),
    _of_complete_run(untouched_contact_warnings),
    _of_motion(overrun_warnings),
    # Remarks on parts without effect.
    _idle_parts,
)
