"""Estimated errors of natural frequencies by the elements of beams."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from beamdae.analysis.eigenproblems.eigensolution import solve_eigenproblem
from beamdae.analysis.linear_dynamics.linearization import Linearization
from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.dispersion import (
    axial_wave_error,
    bending_wave_errors,
    bending_wave_numbers,
    convergence_order,
    element_middles,
    section_values,
)
from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import format_percent
from beamdae.parts.mechanism import Mechanism
from beamdae.results.section_forces.balance import elastic_axial_forces, elastic_section_forces

Array = np.ndarray

_ENERGY_POINTS = 3  # of the quadrature of the strain energy in an element
# Largest change of a coordinate, in natural sizes, for differences of axial forces.
_DIFFERENCE = 1e-5
# Estimated errors above this one are reported; then, errors of 2 % are, and those of 0.3 % are not.
_MIN_REPORTED_ERROR = 0.007
# Estimates by waves under compression from which on the energy of the shape is evaluated.
_MIN_ESTIMATE = 0.1 * _MIN_REPORTED_ERROR
# Larger estimates are meaningless.
_MAX_ESTIMATE = 0.3
# Error for which a number of elements is recommended.
_RECOMMENDED_ERROR = 2e-3
# Modes up to the largest frequency of a response times this factor are examined.
_REACH = 1.5
_FIRST_MODES = 10  # number of modes to begin with when those of a frequency range are computed


def mesh_warnings(
    mechanism: Mechanism,
    equations: EquationsOfMotion,
    state: State,
    eigenvalues: Array,
    shapes: Array,
    shares: Mapping[str, Array],
    alternative: str = "fewer modes",
) -> list[str]:
    """Return a warning for each beam whose elements are too long for the waves of modes.

    Tension, such as that of taut wires and rotating blades, makes bending waves longer. Axial waves
    of the same frequency are longer still, but a single curved element has no motions without axial
    strains between clamps. Compression makes waves shorter and modes slower, so that the same error
    of the bending stiffness is a larger part of a small total stiffness.

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
    alternative
        What the warnings recommend besides more elements.
    """
    rates, sentences = np.abs(eigenvalues.imag), []
    for beam in mechanism.parts.values():
        if not isinstance(beam, Beam) or beam.name not in shares:
            continue
        forces = elastic_axial_forces(beam, equations, state, element_middles(beam))
        errors = bending_wave_errors(beam, rates, np.maximum(forces, 0.0)) * shares[beam.name]
        is_single_arc = beam.mesh.elements == 1 and beam.mesh.largest_turn > 0.0
        for j in np.flatnonzero(errors > _MIN_REPORTED_ERROR):
            energy, _ = _strain_energies(beam, equations, state, shapes[j].real)
            if energy > 0.5 * rates[j] ** 2 * shares[beam.name][j] and not is_single_arc:
                errors[j] = axial_wave_error(beam, float(rates[j])) * shares[beam.name][j]
        compression = np.minimum(forces, 0.0)
        if np.any(compression):
            compressed = bending_wave_errors(beam, rates, compression)
            wave_numbers = bending_wave_numbers(beam, rates, compression)
            bending, mass = section_values(beam, "EI", "rhoA")
            energies = np.max(bending * wave_numbers**4 / mass, axis=1) * shares[beam.name]
            # The energy of a shape takes more time than its estimate from waves.
            for j in np.flatnonzero(compressed * energies > _MIN_ESTIMATE * rates**2):
                if rates[j] > 0.0:
                    _, energy = _strain_energies(beam, equations, state, shapes[j].real)
                    errors[j] = max(errors[j], compressed[j] * energy / rates[j] ** 2)
        reported = np.flatnonzero(errors > _MIN_REPORTED_ERROR)
        if not len(reported):
            continue
        k = int(reported[np.argmin(rates[reported])])
        error = float(errors[k])
        size = f"about {format_percent(error)}"
        if error > _MAX_ESTIMATE:
            size = f"more than {100.0 * _MAX_ESTIMATE:g} %"
        ratio = min(error, _MAX_ESTIMATE) / _RECOMMENDED_ERROR
        count = int(np.ceil(beam.mesh.elements * ratio ** (1.0 / convergence_order(beam))))
        more = f" and {len(reported) - 1} more" if len(reported) > 1 else ""
        sentences.append(
            f"{beam.name}: the elements are too long for mode {k + 1}{more}, whose frequency of "
            f"{rates[k] / (2.0 * np.pi):.4g} Hz has an error of {size}; use elements={count} or "
            f"more, or {alternative}."
        )
    return sentences


def response_mesh_warnings(lin: Linearization, frequency: float) -> list[str]:
    """Return a warning for each beam whose elements are too long for responses.

    Modes up to 1.5 times the frequency are examined, without damping: the response below a
    resonance contains the error of its frequency, multiplied by 2 / (1 - (f / f_mode)^2).

    Parameters
    ----------
    lin
        A linearized mechanism.
    frequency
        The largest frequency of the response [Hz].
    """
    mechanism, limit = lin.equations.mechanism, np.array([_REACH * 2.0 * np.pi * frequency])
    assert mechanism is not None
    # Compression raises the errors of modes beyond those of waves.
    if not any(
        bending_wave_errors(beam, limit)[0] > _MIN_REPORTED_ERROR
        or np.any(elastic_axial_forces(beam, lin.equations, lin.state, element_middles(beam)) < 0.0)
        for beam in beams_of(mechanism)
    ):
        return []
    count, degrees = _FIRST_MODES, lin.equations.n - lin.equations.m
    solution = solve_eigenproblem(lin.linearized_equations, count, damped=False)
    while count < degrees and solution.values[-1].imag <= limit[0]:
        count *= 2
        solution = solve_eigenproblem(lin.linearized_equations, count, damped=False)
    shapes = solution.shapes.T[solution.values.imag <= limit[0]]
    values = solution.values[solution.values.imag <= limit[0]]
    shares = kinetic_energy_shares(lin, shapes)
    return mesh_warnings(
        mechanism, lin.equations, lin.state, values, shapes, shares, "lower frequencies"
    )


def kinetic_energy_shares(lin: Linearization, shapes: Array) -> dict[str, Array]:
    """Return the share of each moving part in the kinetic energy of each mode, (k,), by name.

    Parameters
    ----------
    lin
        A linearized mechanism.
    shapes
        Shapes (k, n) of the modes.
    """
    energy = np.real(shapes.conj().T * (lin.tangent.mass @ shapes.T))
    energy /= np.where(energy.sum(axis=0) > 0.0, energy.sum(axis=0), 1.0)
    return {part.name: energy[part.rows].sum(axis=0) for part in lin.equations.parts}


def _strain_energies(
    beam: Beam, equations: EquationsOfMotion, state: State, shape: Array
) -> tuple[float, float]:
    """Return twice the energies of axial strains and of bending of a mode shape (n,) [J]."""
    scale = _DIFFERENCE / np.max(np.abs(shape) / equations.position_scales)
    points, weights = gauss_points(_ENERGY_POINTS)
    half = 0.5 * beam.mesh.element_lengths[:, None]
    s = (element_middles(beam)[:, None] + half * points).ravel()
    forward, backward = (
        elastic_section_forces(
            beam, equations, State(*(x[None] for x in state._replace(q=state.q + change))), s
        )
        for change in (scale * shape, -scale * shape)
    )
    forces = ((forward - backward) / (2.0 * scale))[:, 0].reshape(3, len(half), -1)
    axial, bending = section_values(beam, "EA", "EI")
    squares = np.sum(forces**2 * half * weights, axis=2)
    return float(np.sum(squares[0] / axial)), float(np.sum(squares[2] / bending))
