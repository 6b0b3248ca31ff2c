"""Warnings about contacts that slide too slowly for the regularization of their friction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.assembly.building import NumberStore, build_observable, select_input_laws
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.parts.forces.contact import Contact
from beamdae.results.trajectory import Trajectory

_MAX_SLOW_SHARE = 0.5  # of the time in contact
# Contacts that creep over smaller distances, relative to the length of the mechanism, stick.
_MIN_SLOW_DISTANCE = 1e-3
_RATIO_AT_FRICTION_SPEED = float(np.tanh(1.0))  # friction force / (friction N)


def slow_sliding_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning per contact that slides below its friction speed most of the time.

    The friction force is then well below friction N. Contacts that stick, and creep over less than
    a thousandth of the length of the mechanism, are exempt.

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
        build_observable(part.name, part.force, coordinates, numbers, {}, laws) for part in contacts
    ]
    p = numbers.all(mechanism.inputs)
    for part, o in zip(contacts, observables, strict=True):
        durations, ratios = [], []
        for interval in trajectory.intervals:
            configuration = interval.configuration
            if configuration is not None and part.name in configuration.inactive:
                continue
            state, times = interval.state, interval.times[:: interval.nodes_per_step]
            q, v = (np.asarray(o.operator @ x.T).T for x in (state.q, state.v))
            normal, tangential = o.function(times, q, v, p[o.data], np.zeros((len(q), 0))).T
            in_contact = normal > 0.0
            steps = np.diff(interval.t)
            weights = 0.5 * (np.append(0.0, steps) + np.append(steps, 0.0))
            durations.append(weights[in_contact])
            ratios.append(np.abs(tangential[in_contact]) / (part.friction * normal[in_contact]))
        if not durations:
            continue
        duration, ratio = np.concatenate(durations), np.concatenate(ratios)
        is_slow = ratio < _RATIO_AT_FRICTION_SPEED
        slow = float(np.sum(duration[is_slow]))
        distance = part.friction_speed * float(duration[is_slow] @ np.arctanh(ratio[is_slow]))
        if (
            slow > _MAX_SLOW_SHARE * float(np.sum(duration))
            and distance > _MIN_SLOW_DISTANCE * equations.length
        ):
            share, mean = slow / np.sum(duration), duration[is_slow] @ ratio[is_slow] / slow
            yield (
                f"{part.name}: the sliding speed is below friction_speed "
                f"({part.friction_speed:g} m/s) during {100.0 * share:.0f} % of the contact, which "
                f"reduces the friction to {100.0 * mean:.0f} % of friction N; use a "
                "smaller friction_speed=."
            )
