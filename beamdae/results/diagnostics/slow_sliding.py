"""Warnings about contacts that slide too slowly for the regularization of their friction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.assembly.building import NumberStore, build_observable, select_input_laws
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, Observable
from beamdae.equations.starts.rank import build_constraint_jacobian
from beamdae.parts.forces.contact import Contact
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MAX_SLOW_SHARE = 0.5  # of the time in contact
# Contacts that move over smaller distances, relative to the length of the mechanism, stick. A load
# below friction N lets them creep, unless drivers and joints prescribe their sliding.
_MIN_DISTANCE = 1e-2
_MIN_PRESCRIBED_DISTANCE = 1e-4
_SPEED_CHANGE = 0.1  # relative to the friction speed
_MIN_RATIO_CHANGE = 1e-6  # friction force / (friction N); less is a rounding error
_RATIO_AT_FRICTION_SPEED = float(np.tanh(1.0))  # friction force / (friction N)


def slow_sliding_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning per contact that slides below its friction speed most of the time.

    The friction force is then well below friction N. Contacts that stick, and creep over less than
    1 % of the length of the mechanism, are exempt; if drivers and joints prescribe the sliding,
    0.01 %.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    mechanism = equations.mechanism
    parts = () if mechanism is None else mechanism.parts.values()
    contacts = [part for part in parts if isinstance(part, Contact) and part.friction]
    if mechanism is None or not contacts:
        return
    coordinates, numbers = map_coordinates(mechanism), NumberStore()
    laws = select_input_laws(mechanism.inputs)
    observables = [
        build_observable(part.name, part.sliding, coordinates, numbers, {}, laws)
        for part in contacts
    ]
    p = numbers.all(mechanism.inputs)
    for part, o in zip(contacts, observables, strict=True):
        durations, ratios = [], []
        for interval in trajectory.intervals:
            configuration = interval.configuration
            if configuration is not None and part.name in configuration.inactive:
                continue
            state, times = interval.state, interval.times[:: interval.nodes_per_step]
            ratio = _friction_ratios(part, o, p, times, state.q, state.v)
            in_contact = np.isfinite(ratio)
            steps = np.diff(interval.t)
            weights = 0.5 * (np.append(0.0, steps) + np.append(steps, 0.0))
            durations.append(weights[in_contact])
            ratios.append(ratio[in_contact])
            if in_contact.any():
                k = np.flatnonzero(in_contact)[-1]
                place = times[k], state.q[k], state.v[k]
        if not sum(map(len, durations)):
            continue
        duration, ratio = np.concatenate(durations), np.concatenate(ratios)
        is_slow = np.abs(ratio) < _RATIO_AT_FRICTION_SPEED
        slow = float(np.sum(duration[is_slow]))
        if slow <= _MAX_SLOW_SHARE * float(np.sum(duration)):
            continue
        slip = np.cumsum(duration[is_slow] * np.arctanh(ratio[is_slow]))
        # Vibrations of a contact that sticks cancel.
        distance = part.friction_speed * float(np.ptp(np.append(0.0, slip))) / equations.length
        if distance > _MIN_DISTANCE or (
            distance > _MIN_PRESCRIBED_DISTANCE
            and _has_prescribed_slip(equations, part, o, p, *place)
        ):
            share = slow / np.sum(duration)
            mean = duration[is_slow] @ np.abs(ratio[is_slow]) / slow
            coefficient = "friction" if part.static is None else "static"
            yield (
                f"{part.name}: the sliding speed is below friction_speed "
                f"({part.friction_speed:g} m/s) during {100.0 * share:.0f} % of the contact, which "
                f"reduces the friction to {100.0 * mean:.0f} % of {coefficient} N; use a "
                "smaller friction_speed=."
            )


def _friction_ratios(
    contact: Contact, o: Observable, p: Array, times: Array, q: Array, v: Array
) -> Array:
    """Return the share tanh(slip / friction_speed) of Coulomb friction, NaN without contact."""
    q, v = (np.asarray(o.operator @ x.T).T for x in (q, v))
    normal, slip = o.function(times, q, v, p[o.data], np.zeros((len(q), 0))).T
    return np.where(normal > 0.0, np.tanh(slip / contact.friction_speed), np.nan)


def _has_prescribed_slip(
    equations: EquationsOfMotion,
    contact: Contact,
    o: Observable,
    p: Array,
    time: Array,
    q: Array,
    v: Array,
) -> bool:
    """Return True if no motion that the constraints allow changes the sliding speed."""
    change = np.random.default_rng(0).uniform(-1.0, 1.0, equations.n)
    if equations.m:
        constraints = build_constraint_jacobian(equations)
        (columns,) = np.nonzero(np.diff(constraints.pattern.indptr))
        (jacobian,) = constraints.at(time[None], q[None])
        change[columns] -= np.linalg.lstsq(jacobian, jacobian @ change[columns])[0]
    speed = _SPEED_CHANGE * contact.friction_speed / equations.length
    speeds = np.stack([v, v + speed * equations.position_scales * change])
    before, after = _friction_ratios(
        contact, o, p, np.stack([time, time]), np.stack([q, q]), speeds
    )
    return bool(abs(after - before) < _MIN_RATIO_CHANGE)
