"""Errors of natural frequencies by the elements of beams.

They are estimated from the waves in the elements. If the estimate is not small or a beam has few
elements, the frequencies are compared with those of halved elements.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.eigenproblems.eigensolution import EigenSolution, solve_eigenproblem
from beamdae.analysis.linear_dynamics.linearization import Linearization
from beamdae.analysis.linear_dynamics.refined_linearization import solve_refined_eigenvalues
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
from beamdae.equations.assembly.refined_beams import RefinedBeams, refine_beams
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import format_percent, name_with_others
from beamdae.results.diagnostics.meshes.coarse_elements import find_coarse_beam
from beamdae.results.section_forces.balance import (
    elastic_axial_forces,
    elastic_section_forces,
)

Array = np.ndarray

_ENERGY_POINTS = 3  # of the quadrature of the strain energy in an element
# Largest change of a coordinate, in natural sizes, for differences of axial forces.
_DIFFERENCE = 1e-5
# Errors above this one are reported; of estimated ones, those of 2 % are, and of 0.3 % are not.
_MIN_REPORTED_ERROR = 0.007
# Estimated errors from which on frequencies are compared with those of halved elements: estimates
# are 0.7 to 6 times the true errors.
_MIN_COMPARED_ERROR = 0.003
# Of more coordinates or modes, only those with long elements for a tension are compared. For 300
# coordinates, a comparison takes 0.1 to 0.3 s; for 1200, one to two seconds.
_MAX_COMPARED_COORDINATES, _MAX_COMPARED_MODES = 1000, 40
# Part of the errors by waves from which on they, and not the tension, are named as the cause.
_MIN_WAVE_SHARE = 0.5
# Estimates by waves under compression from which on the energy of the shape is evaluated.
_MIN_ESTIMATE = 0.1 * _MIN_REPORTED_ERROR
# Beams with a smaller share of the error of a mode are not named.
_MIN_NAMED_SHARE = 0.05
# Larger estimates are meaningless.
_MAX_ESTIMATE = 0.3
# Error for which a number of elements is recommended.
_RECOMMENDED_ERROR = 2e-3
# Modes up to the largest frequency of a response times this factor are examined.
_REACH = 1.5
_BELOW = 1.0 - 1e-6  # of the frequency of the first mode with long elements
_FIRST_MODES = 10  # number of modes to begin with when those of a frequency range are computed


def mesh_warnings(
    lin: Linearization,
    eigenvalues: Array,
    shapes: Array,
    shares: Mapping[str, Array],
    solve_refined: Callable[[RefinedBeams], Array | None],
    alternative: str = "fewer modes",
) -> list[str]:
    """Return a warning of the beams whose elements are too long for modes, or none.

    The estimated error of a mode is the sum of those by the waves in all beams, which are
    proportional to their shares in its kinetic energy. Tension, such as that of taut wires and
    rotating blades, makes bending waves longer. Axial waves of the same frequency are longer still,
    but a single curved element has no motions without axial strains between clamps. Compression
    makes waves shorter and modes slower, so that the same error of the bending stiffness is a
    larger part of a small total stiffness. Unless estimates are small and beams have many elements,
    changes of the frequencies with halved elements replace them.

    Parameters
    ----------
    lin
        A linearized mechanism.
    eigenvalues
        Eigenvalues (k,) of the modes.
    shapes
        Their shapes (k, n), with x^H M x = 1.
    shares
        Share of each part in the kinetic energy of each mode, (k,), by name.
    solve_refined
        Function that returns the eigenvalues with more accurate beams, at least as many, or None if
        they are unknown.
    alternative
        What the warnings recommend besides more elements.
    """
    equations, state, mechanism = lin.equations, lin.state, lin.equations.mechanism
    assert mechanism is not None
    rates = np.abs(eigenvalues.imag)
    beams = [x for x in mechanism.parts.values() if isinstance(x, Beam) and x.name in shares]
    if not beams or not len(rates):
        return []
    errors = _estimate_errors(lin, beams, rates, shapes, shares)
    total = estimate = np.sum(errors, axis=0)

    doubt = find_coarse_beam(lin.full_equations, state.q[None])
    is_taut = doubt is not None and doubt.is_taut
    is_small = equations.n <= _MAX_COMPARED_COORDINATES and len(rates) <= _MAX_COMPARED_MODES
    if is_taut or (is_small and (doubt or np.max(estimate) > _MIN_COMPARED_ERROR)):
        refined = refine_beams(lin.full_equations)
        finer = None if refined is None else solve_refined(refined)
        changes = None if finer is None else _frequency_changes(eigenvalues, finer)
        total = estimate if changes is None else changes

    reported = np.flatnonzero(total > _MIN_REPORTED_ERROR)
    if not len(reported):
        return []
    k = int(reported[np.argmin(rates[reported])])
    # Rounding does not choose between the beams of a symmetric mechanism.
    order = sorted(range(len(beams)), key=lambda j: -float(f"{errors[j, k]:.3g}"))
    worst = beams[order[0]]
    others = [beams[j].name for j in order[1:] if errors[j, k] > _MIN_NAMED_SHARE * estimate[k]]

    size, largest = float(total[k]), float(np.max(total))
    ratio = min(size, _MAX_ESTIMATE) / _RECOMMENDED_ERROR
    count = int(np.ceil(worst.mesh.elements * ratio ** (1.0 / convergence_order(worst))))
    cause = f"{name_with_others(worst.name, others)}: the elements are too long for"
    remedy = f"use elements={count} or more, or {alternative}"
    if doubt is not None and is_taut and estimate[k] < _MIN_WAVE_SHARE * size:
        cause, remedy = f"{doubt.cause} and for", doubt.remedy(size)
    more = ""
    if len(reported) > 1:
        limit = f"more than {100.0 * _MAX_ESTIMATE:g} %"
        most = f"up to {format_percent(largest)}" if largest <= _MAX_ESTIMATE else limit
        more = f" and {len(reported) - 1} more ({most})"
    error = f"about {format_percent(size)}"
    if size > _MAX_ESTIMATE:
        error = f"more than {100.0 * _MAX_ESTIMATE:g} %"
    return [
        f"{cause} mode {k + 1}{more}, whose frequency of {rates[k] / (2.0 * np.pi):.4g} Hz has an "
        f"error of {error}; {remedy}."
    ]


def _estimate_errors(
    lin: Linearization,
    beams: Sequence[Beam],
    rates: Array,
    shapes: Array,
    shares: Mapping[str, Array],
) -> Array:
    """Return the estimated errors (beams, k) of modes with angular frequencies [rad/s], (k,)."""
    waves = [_WaveErrors.of(x, lin.equations, lin.state, rates, shares[x.name]) for x in beams]
    # Where the sum is large, errors of axial motions and of compressed beams are computed.
    large = np.flatnonzero(sum(x.errors for x in waves) > _MIN_COMPARED_ERROR)
    return np.array([x.refine(lin.equations, lin.state, shapes, large) for x in waves])


def _frequency_changes(coarse: Array, fine: Array) -> Array | None:
    """Return the changes of the frequencies of modes with halved elements, (k,).

    They are relative to the frequencies with halved elements. Vibrations are paired in ascending
    order. Returns None if the numbers of other motions differ.

    Parameters
    ----------
    coarse, fine
        Eigenvalues of the model, (k,), and with halved elements, at least as many.
    """
    vibrations = np.flatnonzero(coarse.imag > 0.0)
    vibrations = vibrations[np.argsort(coarse.imag[vibrations], kind="stable")]
    rates = np.sort(fine.imag[fine.imag > 0.0])
    # Fast motions without vibration are decays, of which only one of the models may have some.
    largest = np.max(coarse.imag, initial=0.0)
    counts = [np.sum((x.imag <= 0.0) & (np.abs(x) < largest)) for x in (coarse, fine)]
    if counts[0] != counts[1] or len(rates) < len(vibrations):
        return None
    changes = np.zeros(len(coarse))
    changes[vibrations] = np.abs(coarse.imag[vibrations] / rates[: len(vibrations)] - 1.0)
    return changes


@dataclass(frozen=True)
class _WaveErrors:
    """Errors of frequencies by the elements of a beam.

    Attributes
    ----------
    beam
        The beam.
    rates, share
        Angular frequencies of the modes [rad/s] and the shares of the beam in their kinetic energy,
        (k,) each.
    forces
        Axial forces of the elements [N].
    errors
        Errors by bending waves, (k,).
    """

    beam: Beam
    rates: Array
    share: Array
    forces: Array
    errors: Array

    @classmethod
    def of(
        cls, beam: Beam, equations: EquationsOfMotion, state: State, rates: Array, share: Array
    ) -> _WaveErrors:
        """Return the errors by bending waves under tension."""
        forces = elastic_axial_forces(beam, equations, state, element_middles(beam))
        errors = bending_wave_errors(beam, rates, np.maximum(forces, 0.0)) * share
        return cls(beam, rates, share, forces, errors)

    def refine(
        self, equations: EquationsOfMotion, state: State, shapes: Array, large: Array
    ) -> Array:
        """Return the errors (k,), of the modes `large` without those of axial motions."""
        beam, rates, share = self.beam, self.rates, self.share
        errors = self.errors.copy()
        is_single_arc = beam.mesh.elements == 1 and beam.mesh.largest_turn > 0.0
        if not is_single_arc:
            energies, _ = _strain_energies(beam, equations, state, shapes[large].real)
            for j in large[energies > 0.5 * rates[large] ** 2 * share[large]].tolist():
                errors[j] = axial_wave_error(beam, float(rates[j])) * share[j]
        compression = np.minimum(self.forces, 0.0)
        if not np.any(compression):
            return errors
        compressed = bending_wave_errors(beam, rates, compression)
        wave_numbers = bending_wave_numbers(beam, rates, compression)
        bending, mass = section_values(beam, "EI", "rhoA")
        energies = np.max(bending * wave_numbers**4 / mass, axis=1) * share
        # The energy of a shape takes more time than its estimate from waves.
        is_large = (compressed * energies > _MIN_ESTIMATE * rates**2) & (rates > 0.0)
        (large,) = np.nonzero(is_large)
        _, energies = _strain_energies(beam, equations, state, shapes[large].real)
        changes = compressed[large] * energies / rates[large] ** 2
        errors[large] = np.maximum(errors[large], changes)
        return errors


def response_mesh_warnings(lin: Linearization, frequency: float, about: Any, t: float) -> list[str]:
    """Return a warning of the beams whose elements are too long for responses, or none.

    Modes up to 1.5 times the frequency are examined, without damping if there are no states: the
    response below a resonance contains the error of its frequency, multiplied by
    2 / (1 - (f / f_mode)^2).

    Parameters
    ----------
    lin
        A linearized mechanism.
    frequency
        The largest frequency of the response [Hz].
    about, t
        State and time [s] of the linearization; see `modes`.
    """
    limit = np.array([_REACH * 2.0 * np.pi * frequency])
    # Compression raises the errors of modes beyond those of waves.
    if not any(
        bending_wave_errors(beam, limit)[0] > _MIN_COMPARED_ERROR
        or np.any(elastic_axial_forces(beam, lin.equations, lin.state, element_middles(beam)) < 0.0)
        for beam in beams_of(lin.equations.mechanism)
    ):
        return []
    # Undamped modes do not exist with first-order states, such as those of controllers.
    damped = len(lin.equations.states) > 0
    solution = _solve_up_to(lin, float(limit[0]), damped)
    shapes = solution.shapes.T[solution.values.imag <= limit[0]]
    values = solution.values[solution.values.imag <= limit[0]]
    shares = kinetic_energy_shares(lin, shapes)

    def solve_refined(refined: RefinedBeams) -> Array | None:
        return solve_refined_eigenvalues(lin, refined, about, t, values, damped)

    return mesh_warnings(lin, values, shapes, shares, solve_refined, "lower frequencies")


def _solve_up_to(lin: Linearization, limit: float, damped: bool) -> EigenSolution:
    """Return the modes up to an angular frequency [rad/s], and further ones."""
    count, degrees = _FIRST_MODES, lin.equations.n - lin.equations.m
    solution = solve_eigenproblem(lin.linearized_equations, count, damped)
    while count < degrees and solution.values[-1].imag <= limit:
        count *= 2
        solution = solve_eigenproblem(lin.linearized_equations, count, damped)
    return solution


def find_resolved_frequency(lin: Linearization, highest: float) -> float:
    """Return the frequency up to which elements are short for responses, at most `highest` [Hz].

    Modes up to 1.5 times this frequency have estimated errors of at most 0.3 %.
    """
    mechanism, limit = lin.equations.mechanism, 2.0 * np.pi * _REACH * highest
    beams = [] if mechanism is None else beams_of(mechanism)
    largest = (bending_wave_errors(x, np.array([limit]))[0] for x in beams)
    if max(largest, default=0.0) <= _MIN_COMPARED_ERROR:
        return highest
    solution = _solve_up_to(lin, limit, len(lin.equations.states) > 0)
    is_inside = (solution.values.imag > 0.0) & (solution.values.imag <= limit)
    rates, shapes = solution.values.imag[is_inside], solution.shapes.T[is_inside]
    shares = kinetic_energy_shares(lin, shapes)
    errors = np.sum(_estimate_errors(lin, beams, rates, shapes, shares), axis=0)
    first = np.min(rates[errors > _MIN_COMPARED_ERROR], initial=np.inf)
    return float(min(highest, _BELOW * first / (2.0 * np.pi * _REACH)))


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
    beam: Beam, equations: EquationsOfMotion, state: State, shapes: Array
) -> tuple[Array, Array]:
    """Return twice the energies of axial strains and of bending of mode shapes (k, n) [J]."""
    if not len(shapes):
        return np.zeros(0), np.zeros(0)
    sizes = np.max(np.abs(shapes) / equations.position_scales, axis=1)
    scales = _DIFFERENCE / sizes[:, None]
    points, weights = gauss_points(_ENERGY_POINTS)
    half = 0.5 * beam.mesh.element_lengths[:, None]
    s = (element_middles(beam)[:, None] + half * points).ravel()
    rest = State(*(np.tile(x, (2 * len(shapes), 1)) for x in state))
    changes = np.concatenate([scales * shapes, -scales * shapes])
    forces = elastic_section_forces(beam, equations, rest._replace(q=rest.q + changes), s)
    forward, backward = np.split(forces, 2, axis=1)
    changes = ((forward - backward) / (2.0 * scales)).reshape(3, len(shapes), len(half), -1)
    axial, bending = section_values(beam, "EA", "EI")
    squares = np.sum(changes**2 * half * weights, axis=-1)
    return np.sum(squares[0] / axial, axis=-1), np.sum(squares[2] / bending, axis=-1)
