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
    shares: Mapping[str, Array],
) -> list[str]:
    """Return a warning for each beam whose elements are too long for bending waves of modes.

    Tension, such as that of taut wires and rotating blades, makes the waves longer.

    Parameters
    ----------
    mechanism
        The assembled mechanism.
    equations, state
        Its equations of motion and the state of the modes.
    eigenvalues
        Eigenvalues (k,) of the modes.
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


def _mean_powers(
    beam: Beam, order: int, rates: Array, middles: Array, tension: Array | float = 0.0
) -> Array:
    """Return the mean of (h k)^order over the elements at angular frequencies (k,), (k,).

    The wave number k of a beam under tension N is the root of EI k^4 + N k^2 = rhoA omega^2.
    """
    section = beam.section
    sections = [section if isinstance(section, Section) else section.at(s) for s in middles]
    bending, mass = np.array([(x.EI, x.rhoA) for x in sections]).T
    half = 0.5 * tension / bending
    squares = np.sqrt(half**2 + rates[:, None] ** 2 * mass / bending) - half
    lengths = beam.mesh.element_lengths
    return np.asarray((lengths**order * squares ** (0.5 * order)) @ lengths / np.sum(lengths))
