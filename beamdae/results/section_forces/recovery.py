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
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.shape_functions import gauss_points
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import BeamdaeError, as_real, require_finite, require_iterable, short_repr
from beamdae.results.section_forces.applied_loads import (
    ALL_LOADS,
    AppliedLoads,
    collect_applied_loads,
)
from beamdae.results.section_forces.section_forces import SectionForces
from beamdae.results.section_forces.section_motions import (
    SectionFunction,
    evaluate_sections,
    position_and_angle,
    strains_and_rates,
)
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Arc lengths nearer to each other, over the length, are the same.
SAME_PLACE = 1e-9


def balanced_and_elastic_forces(
    beam: Beam,
    equations: EquationsOfMotion,
    times: Array,
    state: State,
    s: Array,
    before: Array,
    factors: Mapping[str, float] = ALL_LOADS,
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
        How much of what parts do acts, see `collect_applied_loads`.

    Returns
    -------
    tuple of ndarray
        From what acts on the beam, and from its strains.
    """
    along = _Along(beam, equations, state)
    acting = collect_applied_loads(beam, equations, times, state, factors)
    return along.section_forces(s, _carried(beam, acting, s, before)), along.of_strains(s)


def _carried(beam: Beam, acting: AppliedLoads, s: Array, before: Array) -> Array:
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
        found = evaluate_sections(
            position_and_angle, [SectionFunction(p.operator, p.motion) for p in points], *self._own
        )
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
        at = [SectionFunction(value.operator, value.values) for value in values]
        found = evaluate_sections(strains_and_rates, at, *self._own)
        sections = [self._beam.section.at(x) for x in s.tolist()]
        stiffness = np.array([(x.EA, x.GA, x.EI) for x in sections])
        damping = np.array([x.damping for x in sections])[:, None]
        return np.moveaxis(stiffness * (found[..., :3] + damping * found[..., 3:]), -1, 0)


if TYPE_CHECKING:
    from beamdae.equations.equations_of_motion import EquationsOfMotion
    from beamdae.results.solution import Solution

# Rows, and how much of what parts do acts then.
Group = tuple[Array, Mapping[str, float]]

# Sections a stretch between two element boundaries or forces is looked at in, its ends included.
_PER_STRETCH = 5
# Numbers of sections times rows that are evaluated at once.
_AT_ONCE = 100_000


def recover_section_forces(
    solution: Solution, beam: Beam | str, t: Any = None, s: Any = None
) -> SectionForces:
    """Section forces of a beam of a run, see `SectionForces`.

    Parameters
    ----------
    solution
        The run.
    beam
        The beam, or its name.
    t
        Times [s], one or several ascending; default the output times.
    s
        Arc lengths [m], one or several; default the boundaries of elements and places where forces
        act and stay, these from both sides, with three sections between any two of them.
    """
    e = solution.equations
    beam = _beam_of(e, beam)
    times = solution.t if t is None else _given(beam.name, "t", t)
    first, last = solution.trajectory.intervals[0].t[0], solution.trajectory.end
    if not (np.all(np.diff(times) > 0.0) and first <= times[0] and times[-1] <= last):
        raise BeamdaeError(
            f"{beam.name}: t must be times of the run, ascending, {first:g} to {last:g} s, "
            f"got {short_repr(t)}."
        )
    branched, state = solution.trajectory.at(times)
    groups = _by_configuration(solution.trajectory, times)
    places, before = _default(beam, e, branched, state, groups) if s is None else _asked(beam, s)
    found = []
    most = max(_AT_ONCE // max(len(places), beam.mesh.elements * beam.mesh.nodes), 1)
    for rows, factors in groups:
        for k in range(0, len(rows), most):
            some = rows[k : k + most]
            part = State(*(x[some] for x in state))
            given = (branched[some], part, places, before, factors)
            found.append(balanced_and_elastic_forces(beam, e, *given))
    (N, Q, M), strained = (np.concatenate(x, axis=1) for x in zip(*found, strict=True))
    return SectionForces(beam, times, places, N, Q, M, strained)


def recover_section_forces_at_state(
    equations: EquationsOfMotion,
    beam: Beam | str,
    t: float,
    state: State,
    factors: Mapping[str, float],
    s: Any = None,
) -> SectionForces:
    """Section forces at one state, a row of each, of which so much of parts and gravity acts."""
    beam = _beam_of(equations, beam)
    time, groups = np.array([[t, t]]), [(np.zeros(1, int), factors)]
    given = _default(beam, equations, time, state, groups) if s is None else _asked(beam, s)
    (N, Q, M), strained = balanced_and_elastic_forces(beam, equations, time, state, *given, factors)
    return SectionForces(beam, time[:, 0], given[0], N, Q, M, strained)


def _beam_of(equations: EquationsOfMotion, beam: Any) -> Beam:
    """The beam, if it is one of the mechanism that the equations are of."""
    mechanism = equations.mechanism
    parts = {} if mechanism is None else mechanism.parts
    found = parts.get(beam) if isinstance(beam, str) else beam
    if not isinstance(found, Beam) or parts.get(found.name) is not found:
        beams = ", ".join(repr(name) for name, part in parts.items() if isinstance(part, Beam))
        raise BeamdaeError(
            "section_forces: beam must be one of the mechanism that was run, "
            f"{beams or 'which has none'}, got {short_repr(beam)}."
        )
    return found


def _given(part: str, name: str, value: Any) -> Array:
    what = "a number or a list of numbers"
    several = [value] if as_real(value) is not None else require_iterable(part, name, value, what)
    if not several:
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")
    return np.array([require_finite(part, name, x) for x in several])


def _asked(beam: Beam, s: Any) -> tuple[Array, Array]:
    """Arc lengths, and that sections at the end are looked at before what acts there."""
    places = _given(beam.name, "s", s)
    near = SAME_PLACE * beam.length
    if np.any(places < -near) or np.any(places > beam.length + near):
        raise BeamdaeError(
            f"{beam.name}: arc length s must lie in [0, {beam.length:.6g}] m, got {short_repr(s)}."
        )
    places = np.clip(places, 0.0, beam.length)
    return places, places > beam.length - near


def _by_configuration(trajectory: Trajectory, times: Array) -> list[Group]:
    """Rows between switches, and that inactive parts did nothing then."""
    which = trajectory.which(times)
    groups: list[Group] = []
    for k, interval in enumerate(trajectory.intervals):
        active = interval.configuration
        factors = {} if active is None else dict.fromkeys(active.inactive, 0.0)
        rows = np.flatnonzero(which == k)
        if groups and groups[-1][1] == factors:
            rows = np.concatenate([groups.pop()[0], rows])
        groups.append((rows, factors))
    return [(rows, factors) for rows, factors in groups if len(rows)]


def _default(
    beam: Beam,
    e: EquationsOfMotion,
    times: Array,
    state: State,
    groups: list[Group],
) -> tuple[Array, Array]:
    """Sections between boundaries of elements and places where forces act, and stay."""
    length = beam.length
    near, jumps = SAME_PLACE * length, [0.0, length]
    for rows, factors in groups:
        some = np.unique(rows[[0, -1]])
        there = collect_applied_loads(
            beam, e, times[some], State(*(x[some] for x in state)), factors
        ).places
        jumps += there[0, np.abs(there[-1] - there[0]) <= near].tolist()
    inner = np.clip(jumps, 0.0, length)
    ends = np.sort(np.concatenate([np.linspace(0.0, length, beam.mesh.elements + 1), inner]))
    ends = ends[np.append(True, np.diff(ends) > 2.0 * near)]
    places, before = [], []
    for start, end in pairwise(ends.tolist()):
        both = bool(np.any(np.abs(inner - end) <= 2.0 * near))
        places.append(np.linspace(start, end, _PER_STRETCH)[: _PER_STRETCH - 1 + both])
        before.append(np.arange(len(places[-1])) == _PER_STRETCH - 1)
    return np.concatenate(places), np.concatenate(before)
