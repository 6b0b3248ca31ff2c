"""Warnings about contacts that are far away or left at once, and about bodies that do not touch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import SurfaceGapTerm, compile_surface_gaps
from beamdae.errors import name_with_others
from beamdae.model_checks.model_contacts import contacts_of, gaps_of_run
from beamdae.parts.events import have_actions
from beamdae.parts.mechanism import Mechanism
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.parts.forces.contact import Contact
    from beamdae.parts.forces.surfaces import LineSurface

Array = np.ndarray

_MIN_CHANGE = 0.1  # of the gap in the run, relative to the gap at the start
_ROUNDING = 1e-9  # of the gap, relative to its change
# A contact is pressed if its depth exceeds rounding errors and the drift of constraints, relative
# to the length of the mechanism, or if its force matters, relative to the largest one of the run.
_MIN_DEPTH = 1e-10
_MIN_FORCE = 1e-5
_MAX_FIRST_TOUCH = 0.01  # of the run, for pads that are lifted at once
# Smallest gap that indicates an error of units, relative to the sum of the sizes of all bodies and
# of the change of the gap. Guards are seldom farther away; with mm in place of m, it is about 1000.
_MAX_DISTANCE = 5.0
# Bodies fall away from a surface above them: the cosine of the angle between its normal and gravity
# is at least _MIN_CEILING, the gap opens within _MAX_OPENING of the run and ends at _MIN_FALL of
# the length of the mechanism.
_MIN_CEILING = 0.5
_MAX_OPENING = 0.1
_MIN_FALL = 1e-3


def untouched_contact_warnings(
    equations: EquationsOfMotion, trajectory: Trajectory, largest_force: float
) -> Iterator[str]:
    """Yield a warning per contact that is far away, or one if no contact of the mechanism touches.

    The bodies of all contacts have to approach, or to depart, or a contact has friction: a pad is
    meant to slide, and has a warning also if it lies on the surface without a force, or is lifted
    within the first 1 % of the run. Contacts beside others that touch may be guards that are not
    reached. So may be contacts without friction in mechanisms with events that act, those whose
    gap does not change in one direction, such as stops of vibrations, those whose gap changes by
    less than a tenth, and pairs of end stops, of which one approaches and the other one departs.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    largest_force
        Largest entry of the forces and the reactions in the run [N or N m].
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
    if mechanism is None or any(x.inactive for x in intervals):
        return
    times = np.concatenate([x.t for x in intervals])
    rows = [gaps_of_run(x, trajectory) for x in gaps]
    closest = min(range(len(gaps)), key=lambda k: float(np.min(rows[k])))
    smallest = int(np.argmin(rows[closest]))
    others = [x.part for k, x in enumerate(gaps) if k != closest]
    changes = [_steady_change(values) for values in rows]
    if any(contacts[x.part].friction > 0.0 for x in gaps):
        presses = [
            _presses(contacts[x.part], values, equations.length, largest_force)
            for x, values in zip(gaps, rows, strict=True)
        ]
        last = float(times[np.any(presses, axis=0)].max(initial=trajectory.start))
        if last - trajectory.start > _MAX_FIRST_TOUCH * (trajectory.end - trajectory.start):
            return
        if np.any(presses) or rows[closest][smallest] <= 0.0:
            when = f"after t = {last:.2g} s" if last > trajectory.start else "during the run"
            yield (
                f"{name_with_others(gaps[closest].part, others)}: nothing presses the bodies "
                f"together {when}, so that the normal force and the friction are zero; check the "
                "direction of the surface, and that of the force or the motion that should press."
            )
            return
    elif have_actions(mechanism.events) or not (min(changes) > 0.0 or max(changes) < 0.0):
        return
    remedy = (
        "use a later t_end=, or check the place of the surface"
        if changes[closest] < 0.0
        else "check the place and the direction of the surface, and the direction of the motion"
    )
    yield (
        f"{name_with_others(gaps[closest].part, others)}: the bodies do not touch during the run, "
        f"and their smallest distance is {rows[closest][smallest]:.3g} m at "
        f"t = {times[smallest]:.4g} s; {remedy}."
    )


def fallen_contact_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning about points that start at a line above them and fall away from it.

    This is the motion through a floor whose direction is reversed. Mechanisms in which another
    contact touches or approaches are exempt, because the line may be an upper end stop, and so are
    those with events that act.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of a run from its start to its planned end.
    """
    contacts, mechanism = contacts_of(equations), equations.mechanism
    if not contacts or mechanism is None or mechanism.gravity_laws:
        return
    if have_actions(mechanism.events):
        return
    if any(x.inactive for x in trajectory.intervals):
        return
    times = np.concatenate([x.t for x in trajectory.intervals])
    is_early = times - times[0] < _MAX_OPENING * (times[-1] - times[0])
    rounding = _ROUNDING * equations.length
    fallen: dict[str, LineSurface] = {}
    for gap in (x for x in compile_surface_gaps(equations) if x.part in contacts):
        gaps = gaps_of_run(gap, trajectory)
        is_opening = np.min(np.diff(gaps), initial=0.0) >= -rounding
        is_left = is_opening and np.min(gaps[~is_early]) > 0.0
        if gaps[0] > rounding:
            if np.min(gaps) <= 0.0 or gaps[-1] < gaps[0] - rounding:
                return
            continue
        ceiling = _ceiling_of(contacts[gap.part], mechanism)
        if ceiling is None or not is_left:
            return
        if gaps[-1] > _MIN_FALL * equations.length:
            fallen[gap.part] = ceiling
    if not fallen:
        return
    first, *others = fallen
    x, y = (0.0 - component for component in fallen[first].direction)
    yield (
        f"{name_with_others(first, others)}: {contacts[first].point} starts at the surface and "
        f"falls away from it; turn the direction of the line to ({x:g}, {y:g}) if the body should "
        "rest on it."
    )


def _ceiling_of(contact: Contact, mechanism: Mechanism) -> LineSurface | None:
    """Return the surface if it is a line on the ground whose allowed side lies below it."""
    from beamdae.parts.forces.surfaces import LineSurface

    surface, gravity = contact.surface, np.asarray(mechanism.gravity)
    if not isinstance(surface, LineSurface) or surface.on.body is not mechanism.ground:
        return None
    fall = float(np.dot(surface.numbers, gravity))
    is_above = fall > 0.0 and fall >= _MIN_CEILING * float(np.hypot(*gravity))
    return surface if is_above else None


def _presses(contact: Contact, gaps: Array, length: float, largest_force: float) -> Array:
    """Return the mask of the gaps (k,) at which a contact has a normal force."""
    depth = np.maximum(-gaps, 0.0)
    force = float(contact.stiffness) * depth**contact.exponent
    return np.asarray((depth > _MIN_DEPTH * length) | (force > _MIN_FORCE * largest_force))


def _steady_change(gaps: Array) -> float:
    """Return the change of positive gaps (k,) in one direction, or 0 if it is small or reverses."""
    change, steps = float(gaps[-1] - gaps[0]), np.diff(gaps)
    if not np.min(gaps) > 0.0 or abs(change) < _MIN_CHANGE * gaps[0]:
        return 0.0
    is_steady = np.min(steps * np.sign(change)) >= -_ROUNDING * abs(change)
    return change if is_steady else 0.0


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
