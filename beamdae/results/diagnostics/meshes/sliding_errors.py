"""Warnings about reactions of points that slide along beams with a coarse mesh.

Within an element, no polynomial of the deflection follows the kink below a concentrated force. The
beam is too stiff there, by a compliance that depends on the element only. Arches and clamped beams
are stiff themselves; with 4 elements, they lack up to 5 % of their compliance. The vibration of the
point on the beam then has too short a period, and the phase error of its reaction grows with time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from beamdae.beams.beam import Beam
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_percent
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

_MAX_UNREPORTED_ERROR = 0.04
# The error of the recommended mesh, which decreases with the third power of the element length.
_RECOMMENDED_ERROR = 0.02
# Missing compliance in the middle of an element, EI / length^3, by number of nodes: that of a
# clamped beam for elements with linear moments (3 nodes). Measured on straight clamped beams of
# both formulations: 5.2e-3 and 1.3e-3. With 2 nodes, the whole beam is too stiff.
_MISSING_COMPLIANCE = {3: 1.0 / 192.0, 4: 1.0 / 768.0}
_MIN_SAMPLES, _MAX_SAMPLES, _SAMPLES_PER_STEP = 400, 4000, 4
_PERIOD_ITERATIONS = 6  # of the period of the vibration about a moving average over this period
_MAX_PHASE_ERROR = math.sqrt(2.0)  # root mean square of the difference of unrelated vibrations
# A vibration loses the memory of its phase error over twice its decay time, because the motion of
# the point excites it anew.
_MEMORY = 2.0
# Errors are relative to the standard deviation of the reaction, or to this share of its root mean
# square; a point at rest has rounding errors only.
_MIN_SHARE = 0.01


def sliding_error_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield a warning per sliding point if the mesh error of its reaction is above 4 %.

    In 38 runs with points of 0.05 to 20 kg on arches and straight beams of 4 and 8 elements,
    supported or clamped, all 26 errors above 0.7 % are within a factor of 2 of the estimate; its
    memory and its filter were chosen with 34 of these runs. Points start at rest. With 2
    elements, the estimate can be 7 times too small. It is too small on beams that turn, and does
    not exist for elements with 2 nodes.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    mechanism = equations.mechanism
    parts = {} if mechanism is None else mechanism.parts
    for load in parts.values():
        # Moving forces have no coordinates, and their force is given.
        if not (load.moves_along_beam and load.coordinates):
            continue
        error = estimate_sliding_error(equations, trajectory, load)
        if error <= _MAX_UNREPORTED_ERROR:
            continue
        from beamdae.beams.sliding import MAX_ELEMENTS_WITH_SLIDER

        beam: Beam = load.beam  # type: ignore[attr-defined]
        factor = (error / _RECOMMENDED_ERROR) ** (1.0 / 3.0)
        elements = min(math.ceil(factor * beam.mesh.elements), MAX_ELEMENTS_WITH_SLIDER)
        yield (
            f"{load.name}: the mesh error of its reaction, and of all forces that follow it, is "
            f"about {format_percent(error)} (root mean square, relative to their variation), "
            f"because the elements of {beam.name} are too stiff below the point, and the vibration "
            f"too fast; use {elements} elements."
        )


def estimate_sliding_error(
    equations: EquationsOfMotion, trajectory: Trajectory, load: Any
) -> float:
    """Return the estimated mesh error of the reaction of a sliding point.

    It is the root mean square of the error, relative to the standard deviation of the reaction. The
    stiffness of the beam at the point is the ratio of the vibrations of the reaction and of the
    displacement along it.

    Parameters
    ----------
    equations, trajectory
        The equations of motion, and the steps of the run.
    load
        The joint, a `SlidingOnBeam`.
    """
    mesh, names = load.beam.mesh, [f"{load.name}.{axis}" for axis in "xy"]
    duration = trajectory.end - trajectory.start
    if mesh.nodes not in _MISSING_COMPLIANCE or not set(names) <= set(equations.lam_names):
        return 0.0
    if not duration > 0.0:
        return 0.0
    count = int(np.clip(_SAMPLES_PER_STEP * trajectory.steps, _MIN_SAMPLES, _MAX_SAMPLES))
    t = np.linspace(trajectory.start, trajectory.end, count)
    step, (_, state) = t[1] - t[0], trajectory.at(t)
    reaction = state.lam[:, [equations.lam_names.index(x) for x in names]]
    variance = max(
        float(np.sum(np.var(reaction, axis=0))), _MIN_SHARE**2 * float(np.mean(reaction**2))
    )
    if not variance > 0.0:
        return 0.0
    size = np.linalg.norm(reaction, axis=1, keepdims=True)
    normal = reaction / np.where(size > 0.0, size, 1.0)
    assert equations.mechanism is not None
    coordinates = map_coordinates(equations.mechanism)
    of_body = coordinates.slice_of(load.a.piece.owner)
    velocity = load.point_velocity(state.q[:, of_body], state.v[:, of_body])
    speed = np.sum(normal * velocity, axis=1)[:, None]
    displacement = cumulative_trapezoid(speed, dx=step, axis=0, initial=0.0)

    vibration = displacement - np.outer((t - t[0]) / duration, displacement[-1])
    vibration -= np.mean(vibration)
    rate, period = speed, duration
    for _ in range(_PERIOD_ITERATIONS):
        squares = float(np.sum(vibration**2)), float(np.sum(rate**2))
        if not min(squares) > 0.0:
            return 0.0
        period = min(2.0 * np.pi * math.sqrt(squares[0] / squares[1]), duration)
        vibration, rate = (_subtract_average(t, x, period) for x in (displacement, speed))
    change = _subtract_average(t, reaction, period)
    squares = float(np.sum(vibration**2)), float(np.sum(rate**2))
    if not min(squares) > 0.0:
        return 0.0
    frequency = math.sqrt(squares[1] / squares[0])
    stiffness = math.sqrt(float(np.sum(change**2)) / squares[0])

    s = state.q[:, coordinates.slice_of(load)].ravel()
    shift_rate = 0.5 * frequency * stiffness * _missing_compliance(load.beam, s)
    decay_rate = 0.5 * frequency**2 * load.beam.section.at(0.5 * load.beam.length).damping
    memory = math.exp(-decay_rate * step / _MEMORY)
    phase = np.minimum(lfilter([step], [1.0, -memory], shift_rate), _MAX_PHASE_ERROR)
    return math.sqrt(float(np.mean(np.sum(change**2, axis=1) * phase**2)) / variance)


def _missing_compliance(beam: Beam, s: Array) -> Array:
    """Return the compliance [m/N] that elements lack at arc lengths s [m]; 0 off the beam."""
    bounds, lengths = beam.mesh.element_bounds, beam.mesh.element_lengths
    element = np.clip(np.searchsorted(bounds, s) - 1, 0, len(lengths) - 1)
    xi = np.clip((2.0 * s - bounds[element] - bounds[element + 1]) / lengths[element], -1.0, 1.0)
    middles = (0.5 * (bounds[:-1] + bounds[1:])).tolist()
    EI = np.array([beam.section.at(x).EI for x in middles])
    at_middle = _MISSING_COMPLIANCE[beam.mesh.nodes] * lengths**3 / EI
    return np.asarray(at_middle[element] * (1.0 - xi**2))


def _subtract_average(t: Array, values: Array, period: float) -> Array:
    """Subtract the average over a period around each time from the columns."""
    integral = cumulative_trapezoid(values, t, axis=0, initial=0.0)
    ends = [np.clip(t + shift, t[0], t[-1]) for shift in (-0.5 * period, 0.5 * period)]
    first, last = (np.array([np.interp(x, t, column) for column in integral.T]).T for x in ends)
    return np.asarray(values - (last - first) / (ends[1] - ends[0])[:, None])
