"""Errors of periodic motions, measured by the same motion with everything refined together."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from beamdae.accuracy.errors import Errors, Refined, measure_errors
from beamdae.accuracy.refinement import Refinement, refine
from beamdae.accuracy.runs import (
    RTOL_BESIDE_ACCURATE_STEPS,
    compare_columns,
    leave_unchecked,
    refine_method,
)
from beamdae.analysis.periodic.period_map import PeriodMap
from beamdae.analysis.periodic.shooting import Tolerance, settle_and_solve, solve_shooting
from beamdae.errors import BeamdaeError, hold_messages
from beamdae.integrators import Integrator
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_parameters import split_unit
from beamdae.results.frequency_response import FrequencyResponse
from beamdae.results.periodic_motion import PeriodicMotion, floquet_multipliers, largest_modulus

Array = np.ndarray

_FAILURES = (BeamdaeError, np.linalg.LinAlgError)

_STRIDE = 20  # of the checked motions of a curve, besides its ends and its largest motions


@single_threaded
def measure_motion(motion: PeriodicMotion) -> Errors:
    """Return the errors of the columns, of a free period and of the largest multiplier."""
    run = motion.solution
    if not motion.status.success:
        return leave_unchecked(run, "no periodic motion was found")
    if not isinstance(run.made_by, Integrator):
        return leave_unchecked(run, "the motion was loaded from a file")
    method = refine_method(run, RTOL_BESIDE_ACCURATE_STEPS)

    def repeat(causes: Collection[str]) -> tuple[PeriodicMotion, Refined]:
        refinement = refine(run.equations, causes=causes)
        companion = _find_motion(motion, method, refinement)
        return companion, refinement.refined.with_steps(run.made_by)

    reason = "no such motion is found with everything refined"
    unchecked = replace(leave_unchecked(run, reason), has_failed=True)
    return measure_errors(unchecked, motion, repeat, _compare, _FAILURES)


def measure_response(response: FrequencyResponse) -> Errors:
    """Return the errors of motions along a curve: its ends, largest motions and every 20th one."""
    points = response.points
    numbers = {*range(0, len(points), _STRIDE), len(points) - 1}
    numbers |= {int(np.argmax(response.curve(x)[1])) for x in response.varying_columns}
    parts = []
    for point in (points[k] for k in sorted(numbers) if k >= 0):
        # Not `point.errors`, which would keep errors within a limit of time.
        motion = PeriodicMotion(point.solution, point.period, point.multipliers)
        errors = measure_motion(motion)
        at = f"at {response.parameter} = {point.parameter:.6g}"
        names = (split_unit(x) for x in errors.headers)
        headers = tuple(f"{name} {at} [{unit}]" for name, unit in names)
        parts.append(replace(errors, headers=headers))
    return Errors.join(parts) if parts else Errors.unchecked((), np.zeros(0), "no motion was found")


def _find_motion(
    motion: PeriodicMotion, method: Integrator, refinement: Refinement
) -> PeriodicMotion:
    """Return the motion of the refined mechanism near a motion.

    Raises
    ------
    BeamdaeError, numpy.linalg.LinAlgError
        If it is not found.
    """
    run = motion.solution
    first = run.trajectory.intervals[0].state
    q, v = refinement.prolong(first.q[0]), refinement.prolongation @ first.v[0]
    equations = replace(refinement.equations, q0=q, v0=v)
    tolerance = Tolerance.for_integrator("periodic", None, method)
    with hold_messages():
        period_map = PeriodMap.from_equations(equations, method, float(run.t[0]), motion.period)
        if motion.is_free:
            q, v, _ = period_map.settle(0)
            other = solve_shooting(period_map, q, v, tolerance, free_period=True).run
        else:
            other = settle_and_solve(period_map, 0, tolerance).run
        multipliers = floquet_multipliers(other.monodromy())
    if other.relative_deviation > tolerance.accepted:
        raise BeamdaeError("Newton's method does not converge")
    period = other.period_map.period
    return PeriodicMotion(other.solution, period, multipliers, is_free=motion.is_free)


def _compare(motion: PeriodicMotion, other: PeriodicMotion, refined: Refined) -> Errors:
    """Return the errors of a motion relative to another one, without their causes.

    The phase of motions with a free period is arbitrary, so that only peaks are compared.
    """
    names = [*["period [s]"] * motion.is_free, "largest multiplier [-]"]
    values, others = (
        np.array([*[x.period] * motion.is_free, largest_modulus(x.multipliers)])
        for x in (motion, other)
    )
    # Multipliers are compared with 1, the limit of stability.
    scales = np.append(others[:-1], max(1.0, others[-1]))
    errors = Errors.of_values(names, values, others, refined, scales)
    if not motion.solution.columns:
        return errors
    has_phase = not motion.is_free
    of_columns = compare_columns(motion.solution, other.solution, refined, has_phase=has_phase)
    return Errors.join([of_columns, errors])
