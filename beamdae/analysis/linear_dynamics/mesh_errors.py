"""Estimated errors of natural frequencies by the elements of beams."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.dispersion import (
    axial_wave_error,
    bending_wave_errors,
    convergence_order,
    element_middles,
    section_values,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.parts.mechanism import Mechanism
from beamdae.results.section_forces.balance import elastic_axial_forces

Array = np.ndarray

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
        errors = bending_wave_errors(beam, rates) * shares[beam.name]
        if not np.any(errors > _MIN_REPORTED_ERROR):
            continue
        middles = element_middles(beam)
        tension = np.maximum(elastic_axial_forces(beam, equations, state, middles), 0.0)
        errors = bending_wave_errors(beam, rates, tension) * shares[beam.name]
        for j in np.flatnonzero(errors > _MIN_REPORTED_ERROR):
            energy = _axial_energy(beam, equations, state, shapes[j].real, middles)
            if energy > 0.5 * rates[j] ** 2 * shares[beam.name][j]:
                errors[j] = axial_wave_error(beam, float(rates[j])) * shares[beam.name][j]
        reported = np.flatnonzero(errors > _MIN_REPORTED_ERROR)
        if not len(reported):
            continue
        k = int(reported[np.argmin(rates[reported])])
        error = float(errors[k])
        size = f"about {100.0 * error:.2g} %"
        if error > _MAX_ESTIMATE:
            size = f"more than {100.0 * _MAX_ESTIMATE:g} %"
        ratio = min(error, _MAX_ESTIMATE) / _RECOMMENDED_ERROR
        count = int(np.ceil(beam.mesh.elements * ratio ** (1.0 / convergence_order(beam))))
        more = f" and {len(reported) - 1} more" if len(reported) > 1 else ""
        sentences.append(
            f"{beam.name}: the elements are too long for mode {k + 1}{more}, whose frequency of "
            f"{rates[k] / (2.0 * np.pi):.4g} Hz has an error of {size}; use elements={count} or "
            "more, or fewer modes."
        )
    return sentences


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
    (stiffness,) = section_values(beam, "EA")
    return float(forces**2 / stiffness @ beam.mesh.element_lengths)
