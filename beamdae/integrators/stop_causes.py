"""Why runs stop early: growing inputs, meaningless strains, vibrations and singular positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beamdae.beams.beam import beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import list_first
from beamdae.integrators.integrator import DEFAULT_RTOL, Integrator
from beamdae.integrators.limits import PaceCheck, followed_vibration
from beamdae.integrators.sampling import RepeatedSample, describe_growth
from beamdae.model_checks.validity_ranges import describe_meaningless_strain, names_strains
from beamdae.results.outcome import Status
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_STRAIN_SAMPLES = 256  # times since the last check of the motion at which strains are evaluated
_MAX_NAMES = 3
_STEPS = 4096  # at the end of the run, which are examined
# Steps that follow a vibration take 5 to 60 a period; those of BDF of order 2 take 220.
_MIN_TURNS = 20
# Periods in the rest of the run; with fewer, the vibration may be the motion of interest.
_MIN_PERIODS = 1000.0
# Smaller velocities than this share of the largest one of the same unit may be rounding errors.
_MIN_SHARE = 1e-2
# Share of the amplitude that is left in the second half; with less, steps will grow.
_MIN_REMAINING_SHARE = 0.5


def name_cause(
    status: Status,
    equations: EquationsOfMotion,
    trajectory: Trajectory,
    samples: Sequence[RepeatedSample],
    end: float,
    integrator: Integrator,
) -> Status:
    """Return the status with a growing input or a vibration as the first reason to stop.

    `samples` are those of controllers; the run should have reached `end` [s].
    """
    cause = describe_growth(samples)
    # Vibrations with meaningless strains are an effect, not a cause.
    if not cause and status.kind == "limited" and not names_strains(status):
        advice = ""
        if integrator.accuracy.name == "rtol" and integrator.accuracy.value < DEFAULT_RTOL:
            advice = f" or rtol={DEFAULT_RTOL:g}, which keeps deflections within 1 %"
        if integrator.method in ("Ida", "GeneralizedAlpha"):
            advice += ", choose Radau"
        cause = _describe_followed_vibration(equations, trajectory, end, advice)
    if not cause:
        return status
    stop, _, reason = status.sentence.partition(": ")
    return replace(status, sentence=f"{stop}: {cause.rstrip('.')}; {reason}")


def describe_hopeless_motion(
    check: PaceCheck, equations: EquationsOfMotion, trajectory: Trajectory
) -> str:
    """Return the reason to stop a long run, or "": its motion is meaningless, or it is stalled.

    A vibration that the steps follow is not part of the reason: `name_cause` adds it.
    """
    if beams_of(equations.mechanism):
        positions = trajectory.positions_at(
            np.linspace(check.begin, trajectory.end, _STRAIN_SAMPLES)
        )
        if strain := describe_meaningless_strain(equations, positions):
            return check.describe_motion(strain)
    vibration = check.is_steady and _describe_followed_vibration(equations, trajectory, check.end)
    followed_vibration.set(vibration or "")
    return check.describe_stall() if vibration and check.exceeds_limit else ""


def _describe_followed_vibration(
    equations: EquationsOfMotion, trajectory: Trajectory, end: float, advice: str = ""
) -> str:
    """Return a sentence about beams whose lasting vibrations the last steps follow, or "".

    The run should have reached `end` [s]. The period is measured by the turning points of the
    velocities of the beam's nodes. `advice` follows the sentence.
    """
    last = trajectory.intervals[-1]
    t, v = last.t[-_STEPS:], last.state.v[-_STEPS:]
    if len(t) <= _MIN_TURNS:
        return ""
    periods = {}
    for beam in beams_of(equations.mechanism):
        part = equations.coordinates_of_part(beam.name)
        rows = slice(part.rigid.stop, part.rows.stop)
        units = np.array([x.unit for x in equations.coordinates[rows]])
        turns = _count_turns(v[:, rows], units)
        if turns >= _MIN_TURNS and (end - t[-1]) * turns > 2.0 * _MIN_PERIODS * (t[-1] - t[0]):
            periods[beam.name] = 2.0 * (t[-1] - t[0]) / turns
    if not periods:
        return ""
    names = list_first(sorted(periods), _MAX_NAMES)
    return (
        f"the steps follow vibrations of {names} with a period of {min(periods.values()):.2g} s, "
        f"which hardly decay; set damping= of the sections{advice}, or use start='equilibrium' if "
        "the start causes the vibrations"
    )


def _count_turns(v: Array, units: Array) -> int:
    """Return the largest number of turning points of lasting vibrations in the columns of `v`."""
    sizes = np.ptp(v, axis=0)
    early, late = (np.ptp(half, axis=0) for half in np.array_split(v, 2))
    counts = np.count_nonzero(np.diff(np.signbit(np.diff(v, axis=0)), axis=0), axis=0)
    largest = np.array([np.max(sizes[units == x]) for x in units])
    lasts = (sizes > _MIN_SHARE * largest) & (late > _MIN_REMAINING_SHARE * early)
    return max(counts[lasts].tolist(), default=0)
