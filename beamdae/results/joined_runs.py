"""Two runs, one of which went on where the other ended, as one."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.errors import BeamdaeError, short_repr
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.results.solution import Solution


def joined(first: Solution, later: Any) -> Solution:
    """Both runs as one; integrator and model are those of the later, and its status.

    Unless the first one failed: then both did.

    Raises
    ------
    BeamdaeError
        If the later one does not go on from the end of the first, with the same numbers.
    """
    if not isinstance(later, type(first)):
        raise BeamdaeError(f"followed_by: it must be a solution, got {short_repr(later)}.")
    end, begin = first.trajectory.end, float(later.t[0])
    if end != begin:
        raise BeamdaeError(
            f"followed_by: the later run begins at t = {begin:g} s, the first ends at {end:g} s."
        )
    one, other = first.equations, later.equations
    if one.q_names != other.q_names or not np.array_equal(one.p, other.p):
        raise BeamdaeError("followed_by: the runs are of different models, or different numbers.")
    costs = {
        field.name: getattr(first.statistics, field.name) + getattr(later.statistics, field.name)
        for field in fields(first.statistics)
    }
    due = any(not one.done for one in first.event_records)
    return replace(
        later,
        status=first.status.followed_by(later.status, due),
        equations=one,
        trajectory=Trajectory((*first.trajectory.intervals, *later.trajectory.intervals)),
        t=np.concatenate([first.t, later.t[1:]]),
        statistics=replace(later.statistics, **costs),
        # What the first one left to do is among the later ones.
        event_records=(*(one for one in first.event_records if one.done), *later.event_records),
    )
