"""Estimated errors of natural frequencies by the elements of beams."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.sections import Section
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.parts.mechanism import Mechanism
from beamdae.results.section_forces.balance import elastic_axial_forces

Array = np.ndarray

# Relative error of the frequency of a bending wave with the wave number k on elements of length h,
# by number of nodes: (p, c) of c (k h)^p. Measured on slender beams, straight and curved, free or
# on clamps and hinges, with 1 to 8 elements in both formulations: c is 0.7 to 2 times as large.
_DISPERSION = {4: (6, 1.05e-5), 3: (4, 1.9e-3), 2: (2, 8e-2)}
# The same for axial waves, from the theory of the elements.
_AXIAL_DISPERSION = {4: (6, 1.0 / 201600.0), 3: (4, 1.0 / 1440.0), 2: (2, 1.0 / 24.0)}
# Largest change of a coordinate, in natural sizes, for differences of axial forces.
_DIFFERENCE = 1e-5
# Estimated errors above this one are reported; then, errors of 2 % are, and those of 0.3 % are not.
_MIN_REPORTED_ERROR = 0.007
# Larger estimates are meaningless.
_MAX_ESTIMATE = 0.3
# Error for which a number of elements is recommended.
_RECOMMENDED_ERROR = 2e-3


def mesh_warnings(
    mechanism: Mechanism,
    equations: EquationsOfMotion,
    state: State,
    eigenvalues: Array,
    shapes: Array,
    shares: Mapping[str, Array],
) -> list[str]:
    """Return a warning for each beam whose elements are too long for the waves of modes.

    Tension, such as that of taut wires and rotating blades, makes bending waves longer. Axial waves
    of the same frequency are longer still.

    Parameters
    ----------
    mechanism
        The assembled mechanism.
    equations, state
        Its equations of motion and the state of the modes.
    eigenvalues
        Eigenvalues (k,) of the modes.
    shapes
        Their shapes (k, n), with x^H M x = 1.
    shares
        Share of each part in the kinetic energy of each mode, (k,), by name.
    """
    rates, sentences = np.abs(eigenvalues.imag), []
    for beam in mechanism.parts.values():
        if not isinstance(beam, Beam) or beam.name not in shares:
            continue
        order, factor = _DISPERSION[beam.mesh.nodes]
        middles = 0.5 * (beam.mesh.element_bounds[1:] + beam.mesh.element_bounds[:-1])
        errors = factor * _mean_powers(beam, order, rates, middles) * shares[beam.name]
        if not np.any(errors > _MIN_REPORTED_ERROR):
            continue
        tension = np.maximum(elastic_axial_forces(beam, equations, state, middles), 0.0)
        errors = factor * _mean_powers(beam, order, rates, middles, tension) * shares[beam.name]
        for j in np.flatnonzero(errors > _MIN_REPORTED_ERROR):
            energy = _axial_energy(beam, equations, state, shapes[j].real, middles)
            if energy > 0.5 * rates[j] ** 2 * shares[beam.name][j]:
                errors[j] = _axial_error(beam, rates[j], middles) * shares[beam.name][j]
        reported = np.flatnonzero(errors > _MIN_REPORTED_ERROR)
        if not len(reported):
            continue
        k = int(reported[np.argmin(rates[reported])])
        error = float(errors[k])
        size = f"about {100.0 * error:.2g} %"
        if error > _MAX_ESTIMATE:
            size = f"more than {100.0 * _MAX_ESTIMATE:g} %"
        ratio = min(error, _MAX_ESTIMATE) / _RECOMMENDED_ERROR
        count = int(np.ceil(beam.mesh.elements * ratio ** (1.0 / order)))
        more = f" and {len(reported) - 1} more" if len(reported) > 1 else ""
        sentences.append(
            f"{beam.name}: the elements are too long for mode {k + 1}{more}, whose frequency of "
            f"{rates[k] / (2.0 * np.pi):.4g} Hz has an error of {size}; use elements={count} or "
            "more, or fewer modes."
        )
    return sentences


def bending_wave_error(beam: Beam, rate: float) -> float:
    """Return the relative error of the frequency of bending waves, without tension.

    Parameters
    ----------
    beam
        The beam.
    rate
        Angular frequency [rad/s].
    """
    order, factor = _DISPERSION[beam.mesh.nodes]
    middles = 0.5 * (beam.mesh.element_bounds[1:] + beam.mesh.element_bounds[:-1])
    return float(factor * _mean_powers(beam, order, np.array([rate]), middles)[0])


def _axial_energy(
    beam: Beam, equations: EquationsOfMotion, state: State, shape: Array, middles: Array
) -> float:
    """Return twice the energy of the axial strains of a mode shape (n,) [J]."""
    scale = _DIFFERENCE / np.max(np.abs(shape) / equations.position_scales)
    forward, backward = (
        elastic_axial_forces(beam, equations, state._replace(q=state.q + change), middles)
        for change in (scale * shape, -scale * shape)
    )
    forces = (forward - backward) / (2.0 * scale)
    (stiffness,) = _section_values(beam, middles, "EA")
    return float(forces**2 / stiffness @ beam.mesh.element_lengths)


def _axial_error(beam: Beam, rate: float, middles: Array) -> float:
    """Return the relative error of the frequency of an axial wave."""
    stiffness, mass = _section_values(beam, middles, "EA", "rhoA")
    lengths, (order, factor) = beam.mesh.element_lengths, _AXIAL_DISPERSION[beam.mesh.nodes]
    powers = (lengths * rate * np.sqrt(mass / stiffness)) ** order
    return float(factor * (powers @ lengths) / np.sum(lengths))


def _section_values(beam: Beam, s: Array, *names: str) -> Array:
    """Return these properties of the sections at arc lengths (k,), (names, k)."""
    section = beam.section
    sections = [section if isinstance(section, Section) else section.at(x) for x in s]
    return np.array([[getattr(x, name) for x in sections] for name in names])


def _mean_powers(
    beam: Beam, order: int, rates: Array, middles: Array, tension: Array | float = 0.0
) -> Array:
    """Return the mean of (h k)^order over the elements at angular frequencies (k,), (k,).

    The wave number k of a beam under tension N is the root of EI k^4 + N k^2 = rhoA omega^2.
    """
    bending, mass = _section_values(beam, middles, "EI", "rhoA")
    half = 0.5 * tension / bending
    squares = np.sqrt(half**2 + rates[:, None] ** 2 * mass / bending) - half
    lengths = beam.mesh.element_lengths
    return np.asarray((lengths**order * squares ** (0.5 * order)) @ lengths / np.sum(lengths))
