"""Section forces of runs and of states: at which sections, in which rows."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.formulations.first_order import State
from beamdae.errors import BeamdaeError, as_real, require_finite, require_iterable, short_repr
from beamdae.results.section_forces.applied_loads import acting_on
from beamdae.results.section_forces.recovery import SAME_PLACE, balanced_and_strained
from beamdae.results.section_forces.section_forces import SectionForces
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.equations.equations_of_motion import EquationsOfMotion
    from beamdae.results.solution import Solution

Array = np.ndarray
# Rows, and how much of what parts do acts then.
Group = tuple[Array, Mapping[str, float]]

# Sections a stretch between two element boundaries or forces is looked at in, its ends included.
_PER_STRETCH = 5
# Numbers of sections times rows that are evaluated at once.
_AT_ONCE = 100_000


def section_forces(
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
            found.append(balanced_and_strained(beam, e, *given))
    (N, Q, M), strained = (np.concatenate(x, axis=1) for x in zip(*found, strict=True))
    return SectionForces(beam, times, places, N, Q, M, strained)


def of_state(
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
    (N, Q, M), strained = balanced_and_strained(beam, equations, time, state, *given, factors)
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
        there = acting_on(beam, e, times[some], State(*(x[some] for x in state)), factors).places
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
