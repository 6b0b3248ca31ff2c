"""Diagrams of section forces along a beam."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    require_choice,
    require_finite,
)
from beamdae.report.pictures.figures import COLORS, disable_math_text, draw_grid, wrap_title
from beamdae.results.displays import Plot
from beamdae.results.section_forces.section_forces import SECTION_FORCE_HEADERS, SectionForces

# Largest distance of a requested time from the nearest row, relative to the mean row spacing. With
# equally spaced rows, all times between the first and the last row are accepted.
_MAX_TIME_DISTANCE = 0.51
_TIME_ROUNDING = 1e-12


def plot_section_diagram(forces: SectionForces, what: str = "M", t: float | None = None) -> Plot:
    """Plot N, Q or M of a beam over its arc length; see `SectionForces.diagram`."""
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.figure import Figure

    name = forces.beam.name
    require_choice(name, "what", what, tuple(SECTION_FORCE_HEADERS))
    k = list(SECTION_FORCE_HEADERS).index(what)
    values = (forces.N, forces.Q, forces.M)[k]
    figure = Figure(figsize=(5.6, 3.2), layout="constrained")
    axis = figure.add_subplot()
    row = _find_row(forces, t)
    axis.axhline(0.0, color="0.6", lw=0.8)
    if row is None:
        envelope, unit = forces.envelope(), SECTION_FORCE_HEADERS[what].partition(" [")[2]
        (lowest, lower), (highest, upper) = (
            [envelope[f"{what} {name} [{unit}"] for name in (word, f"{word} error")]
            for word in ("min", "max")
        )
        axis.fill_between(forces.s, lowest - lower, highest + upper, color="0.93", lw=0.0)
        axis.fill_between(forces.s, lowest, highest, color="0.85")
        axis.plot(forces.s, highest, color=COLORS[0], lw=1.4)
        axis.plot(forces.s, lowest, color=COLORS[1], lw=1.4)
        time = f"{forces.t[0]:g} to {forces.t[-1]:g} s"
    else:
        line, error = values[row], forces.error[k, row]
        axis.fill_between(forces.s, line - error, line + error, color="0.85", lw=0.0)
        axis.plot(forces.s, line, color=COLORS[0], lw=1.6)
        axis.plot(forces.s, forces.strained[k, row], ".", color=COLORS[1], ms=4)
        time = f"t = {forces.t[row]:g} s"
    axis.set_title(wrap_title(f"{name}, {time}"), fontsize=10)
    axis.set_xlabel("s [m]")
    axis.set_ylabel(SECTION_FORCE_HEADERS[what])
    axis.margins(x=0.0)
    draw_grid(axis)
    disable_math_text(figure)
    return Plot(figure)


def _find_row(forces: SectionForces, t: Any) -> int | None:
    if t is None:
        return 0 if len(forces.t) == 1 else None
    t = require_finite(forces.beam.name, "t", t)
    row = int(np.argmin(np.abs(forces.t - t)))
    distance = np.ptp(forces.t) / max(len(forces.t) - 1, 1)
    if abs(forces.t[row] - t) > _MAX_TIME_DISTANCE * distance + _TIME_ROUNDING * abs(t):
        first, last, given = format_distinct(forces.t[0], forces.t[-1], t)
        raise BeamdaeError(
            f"{forces.beam.name}: t must be close to a time of the section forces ({first} to "
            f"{last} s), got {given} s."
        )
    return row
