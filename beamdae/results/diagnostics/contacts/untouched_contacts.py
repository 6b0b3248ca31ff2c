"""Warnings about the only contact of a mechanism whose bodies do not touch during a run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import compile_surface_gaps
from beamdae.results.diagnostics.contacts.model_contacts import contacts_of
from beamdae.results.trajectory import Trajectory

_MIN_CHANGE = 0.1  # of the gap in the run, relative to the gap at the start
_ROUNDING = 1e-9  # of the gap, relative to its change


def untouched_contact_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> Iterator[str]:
    """Yield a warning if the bodies of the only contact approach or depart, and do not touch.

    Contacts beside others, and in mechanisms with events, may be guards that are not reached. So
    may be contacts whose gap does not change in one direction, such as stops of vibrations, and
    those whose gap changes by less than a tenth.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    if len(contacts_of(equations)) != 1:
        return
    mechanism, intervals = equations.mechanism, trajectory.intervals
    gaps = compile_surface_gaps(equations)
    if (
        mechanism is None
        or mechanism.events
        or len(gaps) != 1
        or any(x.inactive for x in intervals)
    ):
        return
    values = np.concatenate([gaps[0].evaluate(x.t, x.branch, x.state.q) for x in intervals])
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
