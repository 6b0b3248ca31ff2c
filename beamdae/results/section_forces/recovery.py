"""Section forces along a beam from what acts on it, and from its strains.

The force n and the moment m that the part of a beam beyond the arc length s exerts on the part
before it balance everything that acts on the latter (d'Alembert: inertia with the other sign),

    n(s) = -sum F_k - int_0^s f ds,
    m(s) = -sum (M_k + (r_k - r(s)) x F_k) - int_0^s (mu + (r - r(s)) x f) ds.

Forces at sections jump where they act, loads per length are integrated as the polynomials through
the points at which the element integrates inertia: inside an element the moment is of a higher
degree than any derivative of its displacements. What does not add up to nothing over the whole
beam, the residual of the run, is spread evenly along it, so that both ends balance what they are
joined to.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.first_order import State
from beamdae.results.section_forces.applied_loads import ALL, Acting, acting_on
from beamdae.results.section_forces.section_motions import (
    At,
    evaluated,
    place_and_turn,
    strains_and_rates,
)

Array = np.ndarray

# Arc lengths nearer to each other, over the length, are the same.
SAME_PLACE = 1e-9


def balanced_and_strained(
    beam: Beam,
    equations: EquationsOfMotion,
    times: Array,
    state: State,
    s: Array,
    before: Array,
    factors: Mapping[str, float] = ALL,
) -> tuple[Array, Array]:
    """Section forces (N, Q [N], M [N m]) at rows of states, (3, rows, places) each.

    Parameters
    ----------
    times, state
        (t, branch) rows, and rows of states.
    s, before
        Arc lengths [m], (places,). Where a force acts, section forces are those on its far side, or
        on its near side where `before` is true.
    factors
        How much of what parts do acts, see `acting_on`.

    Returns
    -------
    tuple of ndarray
        From what acts on the beam, and from its strains.
    """
    along = _Along(beam, equations, state)
    acting = acting_on(beam, equations, times, state, factors)
    return along.section_forces(s, _carried(beam, acting, s, before)), along.of_strains(s)


def _carried(beam: Beam, acting: Acting, s: Array, before: Array) -> Array:
    """What acts on the beam up to each section, (rows, places, 3)."""
    mesh, length = beam.mesh, beam.length
    weights = gauss_points(mesh.nodes)[1]
    whole = np.einsum("rekc,k->rec", acting.lines, weights)
    ends = np.concatenate([np.zeros_like(whole[:, :1]), np.cumsum(whole, axis=1)], axis=1)
    element, xi = (np.array(x) for x in zip(*map(mesh.locate, s.tolist()), strict=True))
    inside = np.einsum("rpkc,pk->rpc", acting.lines[:, element], _sums(mesh.nodes, xi))
    near = SAME_PLACE * length
    here = np.where(before, s - near, s + near)
    counted = (acting.places[:, None] < here[:, None]).astype(float)
    found = ends[:, element] + inside + counted @ acting.wrenches
    missed = ends[:, -1] + acting.wrenches.sum(axis=1)
    return found - (s / length)[:, None] * missed[:, None]


def _sums(points: int, xi: Array) -> Array:
    """Integrals from -1 to xi of the polynomials through Gauss points, (len(xi), points)."""
    powers = xi[:, None] ** np.arange(1, points + 1) - (-1.0) ** np.arange(1, points + 1)
    return powers / np.arange(1, points + 1) @ _monomials(points)


@lru_cache
def _monomials(points: int) -> Array:
    """Coefficients of the polynomials that are 1 at one Gauss point each, ascending, (power, k)."""
    return np.linalg.inv(np.vander(gauss_points(points)[0], increasing=True))


class _Along:
    """Where the sections of a beam are, and how they are strained, at rows of states."""

    def __init__(self, beam: Beam, equations: EquationsOfMotion, state: State) -> None:
        assert equations.mechanism is not None
        own = map_coordinates(equations.mechanism).slice(beam)
        self._beam, self._own = beam, tuple(x[:, own] for x in state[:3])
        self._start = self._located(np.zeros(1))[0]

    def _located(self, s: Array) -> tuple[Array, Array]:
        """Places (rows, places, 2) and angles (rows, places) of sections."""
        points = (self._beam.kinematics.material_point(x) for x in s.tolist())
        found = evaluated(place_and_turn, [At(p.operator, p.motion) for p in points], *self._own)
        # Elements meet at small angles, sections stand across the curve.
        return found[..., :2], found[..., 2] + self._beam.curve.tangent_angle(s)

    def section_forces(self, s: Array, wrenches: Array) -> Array:
        """(N, Q, M) of wrenches carried up to sections, (3, rows, places)."""
        place, angle = self._located(s)
        n, arm, (c, w) = -wrenches[..., :2], place - self._start, (np.cos(angle), np.sin(angle))
        moment = wrenches[..., 2] + arm[..., 0] * n[..., 1] - arm[..., 1] * n[..., 0]
        axial, shear = c * n[..., 0] + w * n[..., 1], c * n[..., 1] - w * n[..., 0]
        # M lengthens the left side: it is the clockwise moment on the part before the section.
        return np.stack([axial, shear, moment])

    def of_strains(self, s: Array) -> Array:
        """(N, Q, M) of the strains, with their damping part, (3, rows, places)."""
        values = [self._beam.kinematics.strains(x) for x in s.tolist()]
        at = [At(value.operator, value.values) for value in values]
        found = evaluated(strains_and_rates, at, *self._own)
        sections = [self._beam.section.at(x) for x in s.tolist()]
        stiffness = np.array([(x.EA, x.GA, x.EI) for x in sections])
        damping = np.array([x.damping for x in sections])[:, None]
        return np.moveaxis(stiffness * (found[..., :3] + damping * found[..., 3:]), -1, 0)
