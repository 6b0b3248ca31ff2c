"""Colors along beams that show strain, stress or section forces during a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.strains import identity
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.errors import BeamdaeError, require_choice
from beamdae.report.scene.mechanism_scene import count_beam_sections
from beamdae.report.text import engineering_order, scale_unit
from beamdae.results.section_forces.section_motions import (
    evaluate_sections,
)
from beamdae.results.solution import Solution

Array = np.ndarray


class _ColorQuantity(NamedTuple):
    title: str
    unit: str
    is_signed: bool


_QUANTITIES = {
    "strain": _ColorQuantity("largest strain", "-", is_signed=False),
    "stress": _ColorQuantity("largest stress", "Pa", is_signed=False),
    "N": _ColorQuantity("axial force N", "N", is_signed=True),
    "Q": _ColorQuantity("shear force Q", "N", is_signed=True),
    "M": _ColorQuantity("bending moment M", "N m", is_signed=True),
}
# Color scales for magnitudes and for signed quantities, from the lower to the upper limit.
_SEQUENTIAL_SCALE = ("#3a6fc4", "#7660c4", "#b452a3", "#e0566e", "#f58538", "#f5c31d")
_DIVERGING_SCALE = ("#0072B2", "#b8b8b8", "#D55E00")


@dataclass(frozen=True, eq=False)
class BeamColors:
    """Values along beams in each frame, with a common color scale for the whole run.

    Attributes
    ----------
    title
        Name and unit of the quantity.
    values
        Values (frames, sections) by beam name, in the unit of the title.
    limits
        Lower and upper limit of the color scale, which covers all frames.
    """

    title: str
    values: Mapping[str, Array]
    limits: tuple[float, float]

    def segment_values(self, part: str, frame: int) -> Array:
        """Return the values (sections - 1,) between neighboring sections in a frame."""
        along = self.values[part][frame]
        return 0.5 * (along[:-1] + along[1:])

    @property
    def scale(self) -> tuple[str, ...]:
        """Colors at equally spaced values from the lower to the upper limit."""
        return _DIVERGING_SCALE if self.limits[0] < 0.0 else _SEQUENTIAL_SCALE


def available_colors(solution: Solution, times: Array, first: Any = None) -> list[BeamColors]:
    """Return the color quantities that the viewer of an animation can select.

    The quantity `first`, if given, is followed by stress and bending moment. Stress and moment are
    omitted if the run has no beams; stress is also omitted if a section does not define its height.
    The strain is the larger of |eps11 + eta kappa11| at the fiber offsets eta of the top and the
    bottom of the section. Stress and section forces include the damping contribution.

    Raises
    ------
    BeamdaeError
        If `first` is none of "strain", "stress", "N", "Q" and "M", the run has no beams, or strain
        or stress is requested and a section does not define its height.
    """
    quantities = ["stress", "M"]
    beams = _evaluate_beams(solution, times)
    if first is not None:
        first = require_choice("animate", "color", first, tuple(_QUANTITIES))
        quantities = [first, *(x for x in quantities if x != first)]
        if not beams:
            raise BeamdaeError(
                f"animate: color {first!r} requires a beam, but the mechanism has none; omit color."
            )
    colors = []
    for what in quantities if beams else ():
        try:
            values = {x.beam.name: _compute_quantity(what, x) for x in beams}
        except BeamdaeError:
            if what == first:
                raise
            continue
        everything = np.concatenate([np.abs(x).ravel() for x in values.values()])
        largest = float(np.max(everything[np.isfinite(everything)], initial=0.0))
        title, unit, is_signed = _QUANTITIES[what]
        order = engineering_order(largest)
        factor = 10.0**order
        limit = largest / factor or 1.0
        scaled = {part: x / factor for part, x in values.items()}
        limits = (-limit if is_signed else 0.0, limit)
        colors.append(BeamColors(f"{title} [{scale_unit(unit, order)}]", scaled, limits))
    return colors


class _BeamForces(NamedTuple):
    """Values of `Kinematics.section_forces` (frames, sections, 7) along a beam."""

    beam: Beam
    places: list[float]
    values: Array


def _evaluate_beams(solution: Solution, times: Array) -> list[_BeamForces]:
    """Return the section forces of all beams at `times`."""
    mechanism = solution.equations.mechanism
    beams = beams_of(mechanism)
    if mechanism is None or not beams:
        return []
    _, state = solution.trajectory.at(times)
    coordinates, count = map_coordinates(mechanism), count_beam_sections(mechanism)
    forces = []
    for beam in beams:
        q, v = (x[:, coordinates.slice_of(beam)] for x in (state.q, state.v))
        places = np.linspace(0.0, beam.length, count).tolist()
        functions = [beam.kinematics.section_forces(s) for s in places]
        values = evaluate_sections(identity, functions, q, v, np.zeros_like(q))
        forces.append(_BeamForces(beam, places, values))
    return forces


def _compute_quantity(what: str, forces: _BeamForces) -> Array:
    """Return the quantity (frames, sections) along a beam."""
    beam, places, values = forces
    elastic, viscous, rest = np.split(np.moveaxis(values, -1, 0), (3, 6))
    if what in ("N", "Q", "M"):
        k = "NQM".index(what)
        return np.asarray(elastic[k] + viscous[k] + rest[0] * (what == "N"))
    if what == "strain":
        return beam._largest_fiber_stresses(elastic, places, is_stress=False)
    return beam._largest_fiber_stresses(elastic + viscous, places)
