"""Warnings about contacts that are far away, or that never touch as the only contact."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import SurfaceGapTerm, compile_surface_gaps
from beamdae.results.diagnostics.contacts.model_contacts import contacts_of, gaps_of_run
from beamdae.results.trajectory import Trajectory

_MIN_CHANGE = 0.1  # of the gap in the run, relative to the gap at the start
_ROUNDING = 1e-9  # of the gap, relative to its change
# Smallest gap that indicates an error of units, relative to the sum of the sizes of all bodies and
# of the change of the gap. Guards are seldom farther away; with mm in place of m, it is about 1000.
_MAX_DISTANCE = 5.0


def untouched_contact_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield a warning per contact that is far away, or if the bodies of the only one do not touch.

    The bodies of an only contact have to approach or depart. Contacts beside others, and in
    mechanisms with events, may be guards that are not reached. So may be contacts whose gap does
    not change in one direction, such as stops of vibrations, and those whose gap changes by less
    than a tenth.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    contacts = contacts_of(equations)
    if not contacts:
        return
    mechanism, intervals = equations.mechanism, trajectory.intervals
    gaps = [x for x in compile_surface_gaps(equations) if x.part in contacts]
    sentences = [_describe_far_contact(x, equations, trajectory) for x in gaps]
    if any(sentences):
        yield from filter(None, sentences)
        return
    if (
        mechanism is None
        or mechanism.events
        or len(gaps) != 1
        or any(x.inactive for x in intervals)
    ):
        return
    values = gaps_of_run(gaps[0], trajectory)
    times = np.concatenate([x.t for x in intervals])
    first, last, smallest = float(values[0]), float(values[-1]), int(np.argmin(values))
    change, steps = last - first, np.diff(values)
    if not values[smallest] > 0.0 or abs(change) < _MIN_CHANGE * first:
        return
    if np.min(steps * np.sign(change)) < -_ROUNDING * abs(change):
        return
    remedy = (
        "use a later t_end=, or check the place of the surface"
        if change < 0.0
        else "check the place and the direction of the surface"
    )
    yield (
        f"{gaps[0].part}: the bodies do not touch during the run, and their smallest distance is "
        f"{values[smallest]:.3g} m at t = {times[smallest]:.4g} s; {remedy}."
    )


def _describe_far_contact(
    gap: SurfaceGapTerm, equations: EquationsOfMotion, trajectory: Trajectory
) -> str:
    """Return a warning if a gap exceeds the size of the bodies during the whole run, or ""."""
    values = gaps_of_run(gap, trajectory)
    if not len(values):
        return ""
    smallest = float(np.min(values))
    size = sum(x.size for x in equations.parts if not x.is_state) + float(np.ptp(values))
    if not smallest > _MAX_DISTANCE * size:
        return ""
    return (
        f"{gap.part}: the distance of the bodies is at least {smallest:.3g} m during the whole "
        f"run, {smallest / size:.2g} times the size of all bodies and of the motion ({size:.3g} "
        "m); check the unit and the place of the surface."
    )
