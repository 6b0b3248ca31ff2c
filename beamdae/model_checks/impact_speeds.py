"""Warnings about contacts whose restitution holds at another speed than that of impacts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import SurfaceGapTerm, compile_surface_gaps
from beamdae.errors import name_with_others
from beamdae.model_checks.model_contacts import contacts_of
from beamdae.results.trajectory import Interval, Trajectory

Array = np.ndarray

_MAX_SPEED_RATIO = 2.0  # or its reciprocal
_MIN_RESTITUTION_CHANGE = 0.05
_SLOPE_SHARE = 1e-3  # rates of gaps are differences over this fraction of a step
_TOUCHING_SHARE = 1e-12  # of the length of the mechanism; smaller gaps are rounding errors
# Slower bodies than one that moves this share of the length of the mechanism in the run press
# against each other, without an impact.
_MIN_TRAVEL = 1e-5
_MIN_SPEED_SHARE = 1e-9  # of the speeds of the bodies at a gap; rounding errors of rates are below


def impact_speed_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning about contacts whose fastest impact is far from their `impact_speed`.

    Contacts with the same restitution and `impact_speed` have one warning, with the impact that is
    farthest from it. The coefficient of restitution then differs from the given one by more than
    0.05.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    contacts = {
        name: x
        for name, x in contacts_of(equations).items()
        if x.impact_speed and x.hysteresis > 0.0
    }
    duration = trajectory.end - trajectory.start
    if not contacts or not duration > 0.0:
        return
    from beamdae.parts.forces.contact import restitution_at

    slowest = _MIN_TRAVEL * equations.length / duration
    impacts: dict[tuple[float, float], dict[str, float]] = {}
    for gap in compile_surface_gaps(equations):
        contact = contacts.get(gap.part)
        if contact is None or contact.impact_speed is None:
            continue
        speed = max(_fastest_impact(gap, interval) for interval in trajectory.intervals)
        ratio = speed / contact.impact_speed
        # Faster impacts may lie between the stored steps of long runs.
        least = 1.0 / _MAX_SPEED_RATIO if trajectory.stores_all_steps else 0.0
        if speed < slowest or least <= ratio <= _MAX_SPEED_RATIO:
            continue
        law = contact.restitution_or_elastic, contact.impact_speed
        if abs(restitution_at(speed, *law) - law[0]) < _MIN_RESTITUTION_CHANGE:
            continue
        speeds = impacts.setdefault(law, {})
        speeds[gap.part] = max(speed, speeds.get(gap.part, 0.0))
    for (restitution, expected), speeds in impacts.items():
        names = sorted(speeds, key=lambda name: -abs(np.log(speeds[name] / expected)))
        speed = speeds[names[0]]
        yield (
            f"{name_with_others(names[0], names[1:])}: "
            f"the fastest impact is at {speed:.3g} m/s, where the restitution is "
            f"{restitution_at(speed, restitution, expected):.2g}, because "
            f"restitution={restitution:g} holds at impact_speed={expected:g}; pass the expected "
            "speed of the impact."
        )


def _fastest_impact(gap: SurfaceGapTerm, interval: Interval) -> float:
    """Return the largest speed [m/s] at which a gap closes at the beginning of a contact, or 0.

    Bodies that touch at the beginning of the interval and approach each other count, too.
    """
    if gap.part in interval.inactive:
        return 0.0
    t, state = interval.t, interval.state
    steps = np.diff(t)[np.diff(t) > 0.0]
    if not len(steps):
        return 0.0
    values = gap.evaluate(t, interval.branch, state.q)
    touching = _TOUCHING_SHARE * gap.length
    if values[0] <= touching:
        values[0] = min(values[0], 0.0)
    (last_open,) = np.nonzero((values[:-1] > 0.0) & (values[1:] <= 0.0))
    ahead = _SLOPE_SHARE * np.diff(t)[last_open]
    q = state.q[last_open] + ahead[:, None] * state.v[last_open]
    later = gap.evaluate(t[last_open], interval.branch, q)
    speeds = (values[last_open] - later) / ahead
    # Bodies that touch at the start and approach each other were apart a step before. Central
    # differences vanish for bodies that slide along a curved surface.
    around = steps[0] * np.array([-1.0, 0.0, 1.0])
    q = state.q[0] + around[:, None] * state.v[0]
    before, now, after = gap.evaluate(np.full(3, t[0]), interval.branch, q)
    if before > touching >= now:
        speeds = np.append(speeds, (before - after) / (2.0 * steps[0]))
        last_open = np.append(last_open, 0)
    is_impact = speeds > _MIN_SPEED_SHARE * (np.abs(state.v[last_open]) @ gap.lengths)
    return float(np.max(speeds[is_impact], initial=0.0))
