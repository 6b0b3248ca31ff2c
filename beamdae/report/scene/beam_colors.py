"""Colors along beams that show strain, stress or section forces during a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.strains import identity
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.errors import BeamdaeError, require_choice
from beamdae.report.scene.mechanism_scene import count_beam_sections
from beamdae.results.section_forces.recovery import MAX_EVALUATIONS
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
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""))
# Strains below this are shown in thousandths.
_MAX_SMALL_STRAIN = 0.1


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
        Lower and upper limit of the color scale, which covers all frames and output times.
    factor
        Conversion factor from the unit of the title to SI units.
    """

    title: str
    values: Mapping[str, Array]
    limits: tuple[float, float]
    factor: float

    def segment_values(self, part: str, frame: int) -> Array:
        """Return the values (sections - 1,) between neighboring sections in a frame."""
        along = self.values[part][frame]
        return 0.5 * (along[:-1] + along[1:])

    @property
    def scale(self) -> tuple[str, ...]:
        """Colors at equally spaced values from the lower to the upper limit."""
        return _DIVERGING_SCALE if self.limits[0] < 0.0 else _SEQUENTIAL_SCALE


def compute_beam_colors(name: str, solution: Solution, what: Any, times: Array) -> BeamColors:
    """Return strain, stress or a section force along all beams of a run.

    The strain is the larger of |eps11 + eta kappa11| at the fiber offsets eta of the top and the
    bottom of the section. Stress and section forces include the damping contribution. The limits of
    the color scale cover the output times in addition to the frames.

    Parameters
    ----------
    name
        Name of the calling function, used in error messages.
    solution
        The run.
    what
        "strain", "stress", "N", "Q" or "M".
    times
        Times of the frames [s].

    Raises
    ------
    BeamdaeError
        If `what` is invalid, the run has no mechanism or no beams, or strain or stress is requested
        and a section does not define its height.
    """
    what = require_choice(name, "color", what, tuple(_QUANTITIES))
    return _color_beams(name, what, _evaluate_beams(solution, times))


class _BeamForces(NamedTuple):
    """Values of `Kinematics.section_forces` along a beam, and the rows of the frames."""

    beam: Beam
    places: list[float]
    values: Array
    frame_rows: Array


def _color_beams(name: str, what: str, beams: Sequence[_BeamForces]) -> BeamColors:
    if not beams:
        raise BeamdaeError(
            f"{name}: color {what!r} requires a beam, but the mechanism has none; omit color."
        )
    values_by_beam, largest = dict[str, Array](), 0.0
    for x in beams:
        values = _compute_quantity(what, x)
        largest = max(largest, float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0)))
        values_by_beam[x.beam.name] = values[x.frame_rows]
    quantity = _QUANTITIES[what]
    if quantity.unit == "-":
        factor, unit = (1e-3, "10⁻³") if largest < _MAX_SMALL_STRAIN else (1.0, "-")
    else:
        factor, prefix = next(x for x in _PREFIXES if largest >= x[0] or x[0] == 1.0)
        unit = f"{prefix}{quantity.unit}"
    limit = largest / factor or 1.0
    return BeamColors(
        f"{quantity.title} [{unit}]",
        {part: values / factor for part, values in values_by_beam.items()},
        (-limit if quantity.is_signed else 0.0, limit),
        factor,
    )


def available_colors(solution: Solution, times: Array, first: Any = None) -> list[BeamColors]:
    """Return the color quantities that the viewer of an animation can select.

    The quantity `first`, if given, is followed by stress and bending moment. Stress and moment are
    omitted if the run has no beams; stress is also omitted if a section does not define its height.

    Raises
    ------
    BeamdaeError
        If `first` cannot be computed.
    """
    quantities = ["stress", "M"]
    if first is not None:
        first = require_choice("animate", "color", first, tuple(_QUANTITIES))
        quantities = [first, *(x for x in quantities if x != first)]
    beams, colors = _evaluate_beams(solution, times), []
    for what in quantities:
        try:
            colors.append(_color_beams("animate", what, beams))
        except BeamdaeError:
            if what == first:
                raise
    return colors


def _evaluate_beams(solution: Solution, times: Array) -> list[_BeamForces]:
    """Return the section forces of all beams at `times` and at the output times."""
    mechanism = solution.equations.mechanism
    beams = beams_of(mechanism)
    if mechanism is None or not beams:
        return []
    all_times = np.unique(np.concatenate([times, solution.t]))
    _, state = solution.trajectory.at(all_times)
    sections, frame_rows = count_beam_sections(mechanism), np.searchsorted(all_times, times)
    coordinates = map_coordinates(mechanism)
    rows = max(MAX_EVALUATIONS // sections, 1)
    forces = []
    for beam in beams:
        columns = coordinates.slice_of(beam)
        q, v = state.q[:, columns], state.v[:, columns]
        places = np.linspace(0.0, beam.length, sections).tolist()
        functions = [beam.kinematics.section_forces(s) for s in places]
        blocks = [[x[k : k + rows] for x in (q, v, 0.0 * q)] for k in range(0, len(q), rows)]
        values = np.concatenate([evaluate_sections(identity, functions, *x) for x in blocks])
        forces.append(_BeamForces(beam, places, values, frame_rows))
    return forces


def _compute_quantity(what: str, forces: _BeamForces) -> Array:
    """Return the quantity (rows, sections) along a beam."""
    beam, places, values, _ = forces
    elastic, viscous, rest = np.split(np.moveaxis(values, -1, 0), (3, 6))
    if what in ("N", "Q", "M"):
        k = "NQM".index(what)
        return np.asarray(elastic[k] + viscous[k] + rest[0] * (what == "N"))
    if what == "strain":
        return beam.largest_fiber_stresses(elastic, places, is_stress=False)
    return beam.largest_fiber_stresses(elastic + viscous, places)
