"""What beams bear as color along them: strains, stresses and section forces over a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.errors import BeamdaeError, require_choice
from beamdae.parts.mechanism import Mechanism
from beamdae.report.scene.mechanism_scene import count_beam_sections
from beamdae.results.section_forces.section_motions import (
    SectionFunction,
    evaluate_sections,
    strains_and_rates,
)
from beamdae.results.solution import Solution

if TYPE_CHECKING:
    from matplotlib.colors import Colormap, Normalize

Array = np.ndarray

# What is drawn, its title and unit; whether it has a sign.
QUANTITIES = {
    "strain": ("largest strain", "-", False),
    "stress": ("largest stress", "Pa", False),
    "N": ("axial force N", "N", True),
    "Q": ("shear force Q", "N", True),
    "M": ("bending moment M", "N m", True),
}
# From nothing to the most, and from the least below nothing to the most above it.
SIZES = ("#3a6fc4", "#7660c4", "#b452a3", "#e0566e", "#f58538", "#f5c31d")
SIGNS = ("#0072B2", "#b8b8b8", "#D55E00")
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""))
# Numbers of sections times rows that are evaluated at once.
_AT_ONCE = 100_000


@dataclass(frozen=True, eq=False)
class BeamColors:
    """Values along beams in each frame, and the scale they have over the whole run.

    Attributes
    ----------
    title
        With its unit.
    values
        By beam, (frames, sections), in that unit.
    limits
        Least and largest over frames and output times.
    factor
        What one of that unit is [SI].
    """

    title: str
    values: Mapping[str, Array]
    limits: tuple[float, float]
    factor: float

    def of_segments(self, part: str, frame: int) -> Array:
        """Values between the sections."""
        along = self.values[part][frame]
        return 0.5 * (along[:-1] + along[1:])

    @property
    def colors(self) -> tuple[str, ...]:
        """Evenly spaced colors of the scale."""
        return SIGNS if self.limits[0] < 0.0 else SIZES

    @property
    def colormap(self) -> Colormap:
        """The scale for matplotlib."""
        from matplotlib.colors import LinearSegmentedColormap

        return LinearSegmentedColormap.from_list("beams", list(self.colors))

    @property
    def norm(self) -> Normalize:
        """Its limits."""
        from matplotlib.colors import Normalize

        return Normalize(*self.limits)


def compute_beam_colors(name: str, solution: Solution, what: Any, times: Array) -> BeamColors:
    """Strain, stress or section force along all beams of a run; `name` asks for it.

    Strain and stress are the largest in size over the section, |eps11 + eta kappa11| on its
    surfaces, stress with the damping part. The limits are those of the run at these and the output
    times, so that a color is one value in all frames.

    Raises
    ------
    BeamdaeError
        If it is not one of `QUANTITIES`, there are no beams, or one does not know its height.
    """
    what = require_choice(name, "color", what, tuple(QUANTITIES))
    mechanism = solution.equations.mechanism
    beams = [] if mechanism is None else find_beams(mechanism)
    if mechanism is None or not beams:
        raise BeamdaeError(f"{name}: color {what!r} is that of beams, the mechanism has none.")
    every = np.unique(np.concatenate([times, solution.t]))
    _, state = solution.trajectory.at(every)
    sections, shown = count_beam_sections(mechanism), np.searchsorted(every, times)
    owners, found, most = map_coordinates(mechanism), dict[str, Array](), 0.0
    for beam in beams:
        own = owners.slice(beam)
        values = _along(beam, what, sections, state.q[:, own], state.v[:, own])
        most = max(most, float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0)))
        found[beam.name] = values[shown]
    title, unit, signed = QUANTITIES[what]
    factor, prefix = next(x for x in _PREFIXES if most >= x[0] or x[0] == 1.0)
    if unit == "-":
        factor, prefix = (1e-3, "10⁻³ ") if most < 0.1 else (1.0, "")
    limit = most / factor or 1.0
    return BeamColors(
        f"{title} [{prefix}{unit}]".replace("⁻³ -", "⁻³"),
        {part: values / factor for part, values in found.items()},
        (-limit if signed else 0.0, limit),
        factor,
    )


def find_beams(mechanism: Mechanism) -> list[Beam]:
    """The beams of a mechanism."""
    return [part for part in mechanism.parts.values() if isinstance(part, Beam)]


def _along(beam: Beam, what: str, sections: int, q: Array, v: Array) -> Array:
    """Values (rows, sections) at rows of the coordinates of a beam."""
    places = np.linspace(0.0, beam.length, sections).tolist()
    values = [beam.kinematics.strains(s) for s in places]
    at, rows = [SectionFunction(x.operator, x.values) for x in values], max(_AT_ONCE // sections, 1)
    found = np.concatenate(
        [
            evaluate_sections(strains_and_rates, at, *(x[k : k + rows] for x in (q, v, 0.0 * q)))
            for k in range(0, len(q), rows)
        ]
    )
    own = [beam.section.at(s) for s in places]
    damping = np.array([x.damping for x in own])[:, None]
    strains = found[..., :3] + (0.0 if what == "strain" else damping * found[..., 3:])
    if what in ("N", "Q", "M"):
        k = "NQM".index(what)
        return strains[..., k] * np.array([(x.EA, x.GA, x.EI)[k] for x in own])
    top, bottom = (np.array([x.fiber(beam.name, side) for x in own]) for side in ("top", "bottom"))
    surfaces = [strains[..., 0] + eta * strains[..., 2] for eta in (top, bottom)]
    modulus = np.array([x.material.E for x in own]) if what == "stress" else 1.0
    return modulus * np.max(np.abs(surfaces), axis=0)
