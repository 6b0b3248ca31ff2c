"""Default sections along a beam: element ends, loads and jumps on both sides, and between them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from beamdae.beams.beam import STRESS_SECTIONS_OF_TAPERS, Beam
from beamdae.beams.sections import Section
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.results.section_forces.applied_loads import collect_applied_loads
from beamdae.results.section_forces.balance import SAME_SECTION_TOLERANCE, RowGroup

Array = np.ndarray

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
    loaded = np.clip([*jumps, *_jumps_of_section(beam), *beam.section_jumps], 0.0, length)
    count = 1 if isinstance(beam.section, Section) else STRESS_SECTIONS_OF_TAPERS
    stops = np.sort(np.concatenate([beam.mesh.element_bounds, loaded, beam.section_breaks]))
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
