"""Estimated errors of buckling loads by the elements of beams."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.dispersion import (
    buckling_errors,
    convergence_order,
    element_middles,
    section_values,
)
from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import format_percent, name_with_others
from beamdae.results.diagnostics.meshes.sampled_vibrations import rotation_coordinates
from beamdae.results.section_forces.balance import elastic_section_forces

Array = np.ndarray

# Largest change of a coordinate, in natural sizes, for differences of section forces.
_DIFFERENCE = 1e-5
_SECTIONS = 3  # per element, at which the bending of a mode is evaluated
# Estimated errors above this one are reported. Of 120 calls with 1 to 8 elements, 10 structures and
# 5 modes, 69 had the warning; all of the first reported factors were off by at least 0.8 %.
_MIN_REPORTED_ERROR = 0.008
# Larger estimates are meaningless.
_MAX_ESTIMATE = 0.3
# Error for which a number of elements is recommended.
_RECOMMENDED_ERROR = 2e-3
_MIN_NAMED_SHARE = 0.2  # of the error, of further beams


def buckling_mesh_warnings(
    equations: EquationsOfMotion, q: Array, response: Array, factors: Array, shapes: Array
) -> list[str]:
    """Return a warning if the elements of beams are too long for buckling modes; otherwise [].

    Parameters
    ----------
    equations, q
        Equations of motion and positions (n,) of the unloaded equilibrium.
    response
        Change of the positions per load factor, (n,).
    factors, shapes
        Load factors (k,) and mode shapes (n, k).
    """

    def axial_forces(beam: Beam) -> Array:
        middles = element_middles(beam)
        initial = _section_forces(equations, beam, middles, q)[0]
        change = _differentiate(equations, beam, middles, q, response)[0]
        return np.asarray(initial + factors[:, None] * change)

    errors = _estimate_errors(equations, q, shapes, axial_forces)
    (reported,) = np.nonzero(errors.sum(axis=0) > _MIN_REPORTED_ERROR)
    if not len(reported):
        return []
    k = int(reported[0])
    cause, size, remedy = _describe(beams_of(equations.mechanism), errors[:, k])
    more = f" and {len(reported) - 1} more" if len(reported) > 1 else ""
    return [
        f"{cause} mode {k + 1}{more}, whose load factor of {factors[k]:.4g} has an error of "
        f"{size}; {remedy} or more, or fewer modes."
    ]


def critical_point_mesh_note(
    equations: EquationsOfMotion, kind: str, factor: float, q: Array, mode: Array
) -> str:
    """Return a remark if the elements of beams are too long for a critical point; otherwise "".

    Parameters
    ----------
    equations
        The equations of motion.
    kind, factor
        Kind and load factor of the critical point.
    q, mode
        Its positions and its mode shape, (n,).
    """

    def axial_forces(beam: Beam) -> Array:
        return _section_forces(equations, beam, element_middles(beam), q)[:1]

    errors = _estimate_errors(equations, q, mode[:, None], axial_forces)[:, 0]
    if not errors.sum() > _MIN_REPORTED_ERROR:
        return ""
    cause, size, remedy = _describe(beams_of(equations.mechanism), errors)
    return (
        f"{cause} the {kind} at load factor {factor:.6g}, whose error is {size}; {remedy} or more."
    )


def _section_forces(equations: EquationsOfMotion, beam: Beam, s: Array, q: Array) -> Array:
    """Return (N, Q, M) at arc lengths (k,) of a beam at rest, (3, k)."""
    zero = np.zeros(equations.n)
    rows = State(*(x[None] for x in (q, zero, zero, np.zeros(equations.m))))
    return np.asarray(elastic_section_forces(beam, equations, rows, s)[:, 0])


def _differentiate(
    equations: EquationsOfMotion, beam: Beam, s: Array, q: Array, direction: Array
) -> Array:
    """Return the derivatives of (N, Q, M) at arc lengths (k,) along a direction (n,), (3, k)."""
    largest = float(np.max(np.abs(direction) / equations.position_scales))
    step = _DIFFERENCE / largest if largest > 0.0 else 1.0
    forward, backward = (
        _section_forces(equations, beam, s, q + x * direction) for x in (step, -step)
    )
    return np.asarray((forward - backward) / (2.0 * step))


def _estimate_errors(
    equations: EquationsOfMotion,
    q: Array,
    shapes: Array,
    axial_forces: Callable[[Beam], Array],
) -> Array:
    """Return the relative error of the load of each mode (n, k) by each beam, (beams, k).

    The wave number k of a mode in an element is that of a column under its axial force N,
    EI k^2 = -N, and at most that of the bending of the mode, k^2 = int kappa^2 ds / int phi^2 ds
    with the curvature kappa and the rotation phi without its mean, which is smaller on elastic
    supports. The share of a beam in the error is that in the bending energy of the mode.
    `axial_forces` returns the axial forces in the elements of a beam for each mode, (k, elements).
    """
    beams, count = beams_of(equations.mechanism), shapes.shape[1]
    numbers = []
    for beam in beams:
        (stiffness,) = section_values(beam, "EI")
        numbers.append(np.sqrt(np.maximum(-axial_forces(beam), 0.0) / stiffness))
    pairs = list(zip(beams, numbers, strict=True))
    # The bending of modes, which takes longer, only reduces these errors.
    if all(np.all(buckling_errors(*pair) <= _MIN_REPORTED_ERROR) for pair in pairs):
        return np.zeros((len(beams), count))
    bending = [_measure_bending(equations, beam, q, shapes) for beam in beams]
    total = np.sum([energies for energies, _ in bending], axis=0)
    errors = np.zeros((len(beams), count))
    for row, (beam, by_load), (energies, largest) in zip(errors, pairs, bending, strict=True):
        error = buckling_errors(beam, np.minimum(by_load, largest[:, None]))
        with np.errstate(invalid="ignore"):
            row[:] = np.nan_to_num(error * energies / total)
    return errors


def _measure_bending(
    equations: EquationsOfMotion, beam: Beam, q: Array, shapes: Array
) -> tuple[Array, Array]:
    """Return twice the bending energy and the wave number of each mode in a beam, (k,) each."""
    points, weights = gauss_points(_SECTIONS)
    bounds, lengths = beam.mesh.element_bounds, beam.mesh.element_lengths
    s = (bounds[:-1, None] + 0.5 * lengths[:, None] * (1.0 + points)).ravel()
    ds = (0.5 * lengths[:, None] * weights).ravel()
    stiffness = np.repeat(section_values(beam, "EI")[0], _SECTIONS)
    moments = np.array([_differentiate(equations, beam, s, q, shape)[2] for shape in shapes.T])
    rotations = shapes[rotation_coordinates(equations, beam)]
    squares = (moments / stiffness) ** 2 @ ds
    with np.errstate(divide="ignore", invalid="ignore"):
        numbers = np.sqrt(squares / (np.var(rotations, axis=0) * np.sum(ds)))
    return moments**2 / stiffness @ ds, np.nan_to_num(numbers, posinf=np.inf)


def _describe(beams: Sequence[Beam], errors: Array) -> tuple[str, str, str]:
    """Return cause, size and remedy of the error of a mode by each beam (beams,), as text."""
    error = float(errors.sum())
    size = f"about {format_percent(error)}"
    if error > _MAX_ESTIMATE:
        size = f"more than {100.0 * _MAX_ESTIMATE:g} %"
    # Equal beams differ by rounding only.
    order = np.argsort(-np.round(errors / error, 3), kind="stable")
    worst = beams[order[0]]
    others = [beams[j].name for j in order[1:] if errors[j] > _MIN_NAMED_SHARE * error]
    ratio = min(error, _MAX_ESTIMATE) / _RECOMMENDED_ERROR
    count = int(np.ceil(worst.mesh.elements * ratio ** (1.0 / convergence_order(worst))))
    return (
        f"{name_with_others(worst.name, others)}: the elements are too long for",
        size,
        f"use elements={count}",
    )
