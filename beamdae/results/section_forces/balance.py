"""Section forces of a beam from its loads and from its strains.

Cut the beam at the arc length s. The segment beyond the cut exerts a force n and a moment m on the
segment before the cut. This force and moment balance the concentrated loads F_k, M_k at r_k and
the distributed loads f, mu on the segment before the cut, including d'Alembert forces:

    n(s) = -sum F_k - int_0^s f ds,
    m(s) = -sum (M_k + (r_k - r(s)) x F_k) - int_0^s (mu + (r - r(s)) x f) ds.

Section forces jump at concentrated loads. Distributed loads are interpolated by polynomials through
the inertia points of each element and integrated, so that inside an element the moment has a higher
polynomial degree than any derivative of the displacements. The sum of all loads on the beam, which
is the residual of the run, is distributed uniformly along the beam, so that the section forces at
both ends equal the end reactions.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.shape_functions import gauss_points
from beamdae.beams.strains import identity, section_forces
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.results.section_forces.applied_loads import (
    ALL_LOADS,
    AppliedLoads,
    collect_applied_loads,
)
from beamdae.results.section_forces.section_motions import (
    evaluate_sections,
    position_and_angle,
)
from beamdae.results.trajectory import Trajectory

Array = np.ndarray
# Row indices and the load factors that apply to these rows.
RowGroup = tuple[Array, Mapping[str, float]]

SAME_SECTION_TOLERANCE = 1e-9  # distance of equal arc lengths, relative to the length of the beam


def balanced_and_elastic_forces(
    beam: Beam,
    equations: EquationsOfMotion,
    times: Array,
    state: State,
    s: Array,
    before: Array,
    factors: Mapping[str, float] = ALL_LOADS,
) -> tuple[Array, Array]:
    """Return section forces (N [N], Q [N], M [N m]) from the loads and from the strains.

    Parameters
    ----------
    beam
        The beam.
    equations
        Equations of motion of the mechanism.
    times, state
        Rows (t, branch), (rows, 2), and the states at these times, one row per time.
    s
        Arc lengths (sections,) [m].
    before
        For each section, True to evaluate just before a concentrated load or an element end at
        this section, False to evaluate just beyond it, (sections,).
    factors
        Load factors by part name, and of gravity by the name "gravity". Missing factors are 1.

    Returns
    -------
    tuple of ndarray
        Section forces in equilibrium with the loads (3, rows, sections), and section forces
        computed from the strains (3, rows, sections).
    """
    assert equations.mechanism is not None
    kinematics, coordinates = beam.kinematics, map_coordinates(equations.mechanism)
    of_beam = [x[:, coordinates.slice_of(beam)] for x in state[:3]]
    loads = collect_applied_loads(beam, equations, times, state, factors)
    wrenches = _accumulate_loads(beam, loads, s, before)
    points = [kinematics.material_point(x) for x in (0.0, *s.tolist())]
    at = [(x.operator, x.motion) for x in points]
    motion = evaluate_sections(position_and_angle, at, *of_beam)
    # Sections are normal to the curve. The inclination of a material point is not used, because it
    # is the angle of an element, and elements meet at small angles.
    angle = motion[:, 1:, 2] + beam.curve.tangent_angle(s)
    n, arm = -wrenches[..., :2], motion[:, 1:, :2] - motion[:, :1, :2]
    cosine, sine = np.cos(angle), np.sin(angle)
    axial = cosine * n[..., 0] + sine * n[..., 1]
    shear = cosine * n[..., 1] - sine * n[..., 0]
    # M is positive if it stretches the left side: a clockwise moment on the preceding segment.
    moment = wrenches[..., 2] + arm[..., 0] * n[..., 1] - arm[..., 1] * n[..., 0]
    sides = np.where(before, beam.mesh.just_before(s), s).tolist()
    forces = evaluate_sections(section_forces, [*map(kinematics.section_forces, sides)], *of_beam)
    parts: Any = equations.mechanism.parts.values()
    for part in parts:
        if part.load_distribution == "none" and beam in part.bodies:
            pairs = zip(of_beam, state[:3], strict=True)
            both = [np.hstack([x, y[:, coordinates.slice_of(part)]]) for x, y in pairs]
            forces += evaluate_sections(identity, [*map(part._point_values, sides)], *both)
    return np.stack([axial, shear, moment]), np.moveaxis(forces, -1, 0)


def _accumulate_loads(beam: Beam, loads: AppliedLoads, s: Array, before: Array) -> Array:
    """Return the sum of the loads before each section, (rows, sections, 3).

    The residual, the sum of all loads on the beam, is distributed uniformly and subtracted.
    """
    mesh, length = beam.mesh, beam.length
    weights = gauss_points(mesh.nodes)[1]
    by_element = np.einsum("rekc,k->rec", loads.line_loads, weights)
    zero = np.zeros_like(by_element[:, :1])
    up_to_element = np.concatenate([zero, np.cumsum(by_element, axis=1)], axis=1)
    element, xi = (np.array(x) for x in zip(*map(mesh.locate, s.tolist()), strict=True))
    integrals = _integrate_polynomials(mesh.nodes, xi)
    in_element = np.einsum("rpkc,pk->rpc", loads.line_loads[:, element], integrals)
    near = SAME_SECTION_TOLERANCE * length
    limit = np.where(before, s - near, s + near)
    is_included = (loads.arc_lengths[:, None] < limit[:, None]).astype(float)
    total = up_to_element[:, element] + in_element + is_included @ loads.wrenches
    residual = up_to_element[:, -1] + loads.wrenches.sum(axis=1)
    return total - (s / length)[:, None] * residual[:, None]


def _integrate_polynomials(points: int, xi: Array) -> Array:
    """Return the integrals from -1 to `xi` of the Lagrange polynomials of the Gauss points.

    The shape is (len(xi), points).
    """
    powers = xi[:, None] ** np.arange(1, points + 1) - (-1.0) ** np.arange(1, points + 1)
    return powers / np.arange(1, points + 1) @ _lagrange_coefficients(points)


@lru_cache
def _lagrange_coefficients(points: int) -> Array:
    """Return the coefficients of the Lagrange polynomials of Gauss points, (power, point)."""
    return np.linalg.inv(np.vander(gauss_points(points)[0], increasing=True))


def group_rows(trajectory: Trajectory, times: Array) -> list[RowGroup]:
    """Group consecutive rows with the same active parts; load factors of inactive parts are 0."""
    index = trajectory.interval_index(times)
    groups: list[RowGroup] = []
    for k, interval in enumerate(trajectory.intervals):
        factors = dict.fromkeys(interval.inactive, 0.0)
        rows = np.flatnonzero(index == k)
        if groups and groups[-1][1] == factors:
            rows = np.concatenate([groups.pop()[0], rows])
        groups.append((rows, factors))
    return [(rows, factors) for rows, factors in groups if len(rows)]
