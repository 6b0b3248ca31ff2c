"""Recovery of the section forces of beams over the times of a run, or at one state."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from beamdae.beams.beam import STRESS_SECTIONS_OF_TAPERS, Beam, beams_of
from beamdae.beams.sections import Section
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.errors import (
    BeamdaeError,
    as_real,
    format_distinct,
    plain_text,
    require_finite,
    require_iterable,
    short_repr,
)
from beamdae.results.run_data import RunData
from beamdae.results.section_forces.applied_loads import collect_applied_loads
from beamdae.results.section_forces.balance import (
    SAME_SECTION_TOLERANCE,
    RowGroup,
    balanced_and_elastic_forces,
    group_rows,
)
from beamdae.results.section_forces.section_forces import SectionForces

Array = np.ndarray

MAX_STEPS = 10_000  # at which section forces between rows are evaluated
MAX_EVALUATIONS = 100_000  # sections times rows per evaluation, which limits the memory


# Relative change of stiffnesses, or change of the curvature times the radius of gyration, between
# both sides of an element end, above which it is a jump.
_MIN_JUMP = 1e-6
# Of constant cross-sections between two element boundaries or loads, and along the whole beam: its
# elements may be few and of a high degree.
_INTERVALS_PER_STRETCH = 4
_INTERVALS_PER_BEAM = 32


def default_sections(
    beam: Beam,
    e: EquationsOfMotion,
    times: Array,
    state: State,
    groups: list[RowGroup],
) -> tuple[Array, Array]:
    """Return arc lengths [m] at and between element boundaries and concentrated loads.

    The second array is True for sections that are evaluated just before a load or a jump.
    """
    length = beam.length
    near, jumps = SAME_SECTION_TOLERANCE * length, [0.0, length]
    for rows, factors in groups:
        # A load at the same section in the first and the last row is taken as fixed.
        ends = np.unique(rows[[0, -1]])
        states = State(*(x[ends] for x in state))
        s = collect_applied_loads(beam, e, times[ends], states, factors).arc_lengths
        jumps += s[0, np.abs(s[-1] - s[0]) <= near].tolist()
    loaded = np.clip([*jumps, *_jumps_of_section(beam), *beam.section.jumps], 0.0, length)
    count = 1 if isinstance(beam.section, Section) else STRESS_SECTIONS_OF_TAPERS
    stops = np.sort(np.concatenate([beam.mesh.element_bounds, loaded, beam.section.breaks]))
    stops = stops[np.append(True, np.diff(stops) > 2.0 * near)]
    arc_lengths, before = [], []
    for start, end in pairwise(stops.tolist()):
        has_jump = bool(np.any(np.abs(loaded - end) <= 2.0 * near))
        share = math.ceil(_INTERVALS_PER_BEAM * (end - start) / length)
        intervals = max(count * _INTERVALS_PER_STRETCH, share)
        stretch = np.linspace(start, end, intervals + 1)
        # The end of a stretch is the start of the next one, except on the other side of a jump.
        arc_lengths.append(stretch[: intervals + has_jump])
        before.append(np.arange(len(arc_lengths[-1])) == intervals)
    return np.concatenate(arc_lengths), np.concatenate(before)


def _jumps_of_section(beam: Beam) -> list[float]:
    """Return the element ends [m] at which the section or the stress-free curvature jumps."""
    jumps = []
    ends = beam.mesh.element_bounds[1:-1]
    for before, end in zip(beam.mesh.just_before(ends).tolist(), ends.tolist(), strict=True):
        one, other = beam.section.at(before), beam.section.at(end)
        turn = abs(beam.free_curvature(end) - beam.free_curvature(before))
        is_jump = (
            one.material != other.material
            or not math.isclose(one.EA, other.EA, rel_tol=_MIN_JUMP)
            or not math.isclose(one.EI, other.EI, rel_tol=_MIN_JUMP)
            or turn * math.sqrt(other.EI / other.EA) > _MIN_JUMP
        )
        jumps += [end] * is_jump
    return jumps


def recover_section_forces(
    run: RunData, beam: Beam | str, t: Any, s: Any, find_companion: Callable[[], RunData | None]
) -> SectionForces:
    """Return the section forces of a beam in a run; see `Solution.section_forces`.

    `find_companion` returns the run with everything refined, or None.
    """
    trajectory, sampler = run.trajectory, _sample_run(run, beam)
    name = sampler.beam.name
    times = run.t if t is None else _require_numbers(name, "t", t)
    first, last = trajectory.start, trajectory.end
    if not (np.all(np.diff(times) > 0.0) and first <= times[0] and times[-1] <= last):
        begin, end, *_ = format_distinct(first, last, times[0], times[-1])
        raise BeamdaeError(
            f"{name}: t must contain ascending times of the run ({begin} to {end} s), got "
            f"{short_repr(t)}."
        )
    trajectory.warn_between_rows(name, times)
    steps = np.unique(np.concatenate([x.t for x in trajectory.intervals]))
    steps = steps[(steps > times[0]) & (steps < times[-1])]
    steps = steps[:: 1 + len(steps) // MAX_STEPS]

    def refine() -> SectionSampler | None:
        other = find_companion()
        return None if other is None else _sample_run(other, name)

    return sampler.recover(times, s, steps, refine)


def _sample_run(run: RunData, beam: Beam | str) -> SectionSampler:
    trajectory = run.trajectory

    def states_at(times: Array) -> tuple[Array, State, list[RowGroup]]:
        times = np.clip(times, trajectory.start, trajectory.end)
        return *trajectory.at(times), group_rows(trajectory, times)

    return SectionSampler(run.equations, find_beam(run.equations, beam), states_at)


@dataclass(frozen=True, eq=False)
class SectionSampler:
    """Section forces of a beam at any sections and times.

    Attributes
    ----------
    equations, beam
        Equations of motion of the mechanism, and the beam.
    states_at
        Function of ascending times (k,) [s] that returns rows (t, branch), (k, 2), the states, and
        the groups of rows with the same load factors.
    """

    equations: EquationsOfMotion
    beam: Beam
    states_at: Callable[[Array], tuple[Array, State, list[RowGroup]]]

    def __call__(self, times: Array, s: Array, before: Array) -> Array:
        """Return N, Q and M (3, rows, sections)."""
        return self._evaluate(times, s, before)[0]

    def recover(
        self, times: Array, s: Any, steps: Array, refine: Callable[[], SectionSampler | None]
    ) -> SectionForces:
        """Return the section forces at times [s] and arc lengths [m]; see `SectionForces`.

        `steps` are the times of the steps between these times [s], `refine` returns the sampler of
        the result with everything refined, or None.

        Raises
        ------
        BeamdaeError
            If an arc length is out of range.
        """
        if s is None:
            sections = default_sections(self.beam, self.equations, *self.states_at(times))
        else:
            name, length = self.beam.name, self.beam.length
            s_given, near = _require_numbers(name, "s", s), SAME_SECTION_TOLERANCE * length
            if np.any(s_given < -near) or np.any(s_given > length + near):
                most, _ = format_distinct(length, np.max(s_given))
                raise BeamdaeError(
                    f"{name}: arc length s must lie in [0, {most}] m, got {short_repr(s)}."
                )
            # At the end of the beam, section forces are those before a load.
            s_given = np.clip(s_given, 0.0, length)
            sections = s_given, s_given > length - near
        (N, Q, M), strained = self._evaluate(times, *sections)
        of_sections = N, Q, M, strained, sections[1], s is None, steps
        return SectionForces(self.beam, times, sections[0], *of_sections, self, refine)

    def _evaluate(self, times: Array, s: Array, before: Array) -> tuple[Array, Array]:
        """Return section forces from the loads and from the strains, (3, rows, sections) each."""
        branch_times, state, groups = self.states_at(times)
        blocks = []
        columns = max(len(s), self.beam.mesh.elements * self.beam.mesh.nodes)
        block_size = max(MAX_EVALUATIONS // columns, 1)
        for rows, factors in groups:
            for k in range(0, len(rows), block_size):
                block = rows[k : k + block_size]
                states = State(*(x[block] for x in state))
                at = branch_times[block]
                blocks.append(
                    balanced_and_elastic_forces(
                        self.beam, self.equations, at, states, s, before, factors
                    )
                )
        balanced, strained = (np.concatenate(x, axis=1) for x in zip(*blocks, strict=True))
        return balanced, strained


def find_beam(equations: EquationsOfMotion, beam: Any) -> Beam:
    """Return a beam, or the beam with a name; reject those that the mechanism does not contain."""
    beams = beams_of(equations.mechanism)
    beam = plain_text(beam)
    for candidate in beams:
        if candidate is beam or (isinstance(beam, str) and candidate.name == beam):
            return candidate
    names = ", ".join(repr(candidate.name) for candidate in beams)
    raise BeamdaeError(
        "section_forces: beam must be a beam of the mechanism "
        f"({names or 'no beams'}), got {short_repr(beam)}."
    )


def _require_numbers(part: str, name: str, value: Any) -> Array:
    what = "a number or a list of numbers"
    numbers = [value] if as_real(value) is not None else require_iterable(part, name, value, what)
    if not numbers:
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")
    return np.array([require_finite(part, name, number) for number in numbers])
