"""Estimated errors of natural frequencies by the elements of beams."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.sections import Section
from beamdae.parts.mechanism import Mechanism

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
    mechanism: Mechanism, eigenvalues: Array, shares: Mapping[str, Array]
) -> list[str]:
    """Return a warning for each beam whose elements are too long for bending waves of modes.

    Parameters
    ----------
    mechanism
        The assembled mechanism.
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
        errors = factor * _mean_power(beam, order) * rates ** (0.5 * order) * shares[beam.name]
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


def _mean_power(beam: Beam, order: int) -> float:
    """Return the mean of (h k)^order over the beam at a frequency of 1 rad/s."""
    lengths, bounds = beam.mesh.element_lengths, beam.mesh.element_bounds
    middles = 0.5 * (bounds[1:] + bounds[:-1])
    section = beam.section
    sections = [section if isinstance(section, Section) else section.at(s) for s in middles]
    numbers = np.array([(x.rhoA / x.EI) ** 0.25 for x in sections])
    return float(np.average((lengths * numbers) ** order, weights=lengths))
