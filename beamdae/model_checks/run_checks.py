"""Checks of completed runs, whose warnings `Solution.warnings` lists in the order of this file.

A check is a function of a run that yields sentences. To add one, write the function in
`model_checks` and add it to `RUN_CHECKS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.part_warnings import switch_warnings
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.errors import format_percent
from beamdae.model_checks.coarse_rows import coarse_row_warnings
from beamdae.model_checks.contacts import (
    deep_contact_warnings,
    impact_order_warnings,
    start_inside_warnings,
)
from beamdae.model_checks.strain_limits import (
    names_strains,
    sample_positions,
    strain_warnings,
)
from beamdae.model_checks.unstable_motions import unstable_motion_warnings
from beamdae.model_checks.validity_ranges import overrun_warnings, table_range_warnings
from beamdae.results.rest import has_rounding_forces
from beamdae.results.run_data import RunData
from beamdae.results.singular_positions import singularity_warnings, unbounded_warnings

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
    # ... single forces, and parts without effect.
    _velocity_jumps,
    deep_contact_warnings,
    impact_order_warnings,
    lambda run: switch_warnings(run.equations.mechanism),
)
