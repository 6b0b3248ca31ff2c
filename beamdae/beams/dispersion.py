"""Errors of the frequencies of waves in beams by long elements."""

from __future__ import annotations

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.sections import Section

Array = np.ndarray

# Relative error of the frequency of a bending wave with the wave number k on elements of length h,
# by number of nodes: (p, c) of c (k h)^p. Measured on slender beams, straight and curved, free or
# on clamps and hinges, with 1 to 8 elements in both formulations: c is 0.7 to 2 times as large.
_BENDING = {4: (6, 1.05e-5), 3: (4, 1.9e-3), 2: (2, 8e-2)}
# The same for axial waves, from the theory of the elements.
_AXIAL = {4: (6, 1.0 / 201600.0), 3: (4, 1.0 / 1440.0), 2: (2, 1.0 / 24.0)}


def convergence_order(beam: Beam) -> int:
    """Return the order of convergence of frequencies with the element length."""
    return _BENDING[beam.mesh.nodes][0]


def element_middles(beam: Beam) -> Array:
    """Return the arc lengths of the middles of the elements, (elements,) [m]."""
    bounds = beam.mesh.element_bounds
    return np.asarray(0.5 * (bounds[1:] + bounds[:-1]))


def bending_wave_numbers(beam: Beam, rates: Array, tension: Array | float = 0.0) -> Array:
    """Return the wave numbers of bending waves in the elements, (k, elements) [1/m].

    The wave number k of a beam under tension N is the root of EI k^4 + N k^2 = rhoA omega^2.

    Parameters
    ----------
    beam
        The beam.
    rates
        Angular frequencies (k,) [rad/s].
    tension
        Tension in the elements, (elements,) or the same in all [N].
    """
    bending, mass = section_values(beam, "EI", "rhoA")
    half = 0.5 * tension / bending
    return np.sqrt(np.sqrt(half**2 + rates[:, None] ** 2 * mass / bending) - half)


def bending_wave_errors(beam: Beam, rates: Array, tension: Array | float = 0.0) -> Array:
    """Return the relative errors of the frequencies of bending waves, (k,).

    Parameters
    ----------
    beam, rates, tension
        See `bending_wave_numbers`.
    """
    order, factor = _BENDING[beam.mesh.nodes]
    lengths = beam.mesh.element_lengths
    powers = (lengths * bending_wave_numbers(beam, rates, tension)) ** order
    return np.asarray(factor * (powers @ lengths) / np.sum(lengths))


def axial_wave_error(beam: Beam, rate: float) -> float:
    """Return the relative error of the angular frequency `rate` [rad/s] of an axial wave."""
    order, factor = _AXIAL[beam.mesh.nodes]
    stiffness, mass = section_values(beam, "EA", "rhoA")
    lengths = beam.mesh.element_lengths
    powers = (lengths * rate * np.sqrt(mass / stiffness)) ** order
    return float(factor * (powers @ lengths) / np.sum(lengths))


def section_values(beam: Beam, *names: str) -> Array:
    """Return these properties of the sections in the middles of the elements, (names, elements)."""
    middles, section = element_middles(beam), beam.section
    sections = [section if isinstance(section, Section) else section.at(x) for x in middles]
    return np.array([[getattr(x, name) for x in sections] for name in names])
