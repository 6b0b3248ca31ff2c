"""Diagrams of section forces along a beam."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError, require_choice, require_finite
from beamdae.report.pictures.figures import COLORS, disable_math_text, wrap_title
from beamdae.results.displays import Plot
from beamdae.results.section_forces.section_forces import FORCES, SectionForces


def plot_section_diagram(forces: SectionForces, what: str = "M", t: float | None = None) -> Plot:
    """Draw N, Q or M of a beam over its arc length, at one time or as an envelope.

    The line is what balances the loads, dots are what the strains say, and the gray band is the
    estimated error.

    Parameters
    ----------
    forces
        See `section_forces`.
    what
        "N", "Q" or "M".
    t
        One of the times of the forces [s]; default the only one of these, or the envelope of all.

    Returns
    -------
    Plot
        Shown by a notebook; `Plot.save` writes it to a file.
    """
    # Here, for it takes longer to import than some commands to run.
    from matplotlib.figure import Figure

    name = forces.beam.name
    require_choice(name, "what", what, tuple(FORCES))
    k = list(FORCES).index(what)
    values = (forces.N, forces.Q, forces.M)[k]
    figure = Figure(figsize=(5.6, 3.2), layout="constrained")
    axes = figure.add_subplot()
    row = _row(forces, t)
    axes.axhline(0.0, color="0.6", lw=0.8)
    if row is None:
        axes.fill_between(forces.s, values.min(axis=0), values.max(axis=0), color="0.85")
        for bound, color in zip((values.max(axis=0), values.min(axis=0)), COLORS, strict=False):
            axes.plot(forces.s, bound, color=color, lw=1.4)
        when = f"{forces.t[0]:g} to {forces.t[-1]:g} s"
    else:
        line, error = values[row], forces.error[k, row]
        axes.fill_between(forces.s, line - error, line + error, color="0.85", lw=0.0)
        axes.plot(forces.s, line, color=COLORS[0], lw=1.6)
        axes.plot(forces.s, forces.strained[k, row], ".", color=COLORS[1], ms=4)
        when = f"t = {forces.t[row]:g} s"
    axes.set_title(wrap_title(f"{name}, {when}"), fontsize=10)
    axes.set_xlabel("s [m]")
    axes.set_ylabel(FORCES[what])
    axes.margins(x=0.0)
    axes.grid(color="0.9", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    disable_math_text(figure)
    return Plot(figure)


def _row(forces: SectionForces, t: Any) -> int | None:
    """The row of a time; None for all of them."""
    if t is None:
        return 0 if len(forces.t) == 1 else None
    t = require_finite(forces.beam.name, "t", t)
    row = int(np.argmin(np.abs(forces.t - t)))
    apart = np.ptp(forces.t) / max(len(forces.t) - 1, 1)
    if abs(forces.t[row] - t) > 0.51 * apart + 1e-12 * abs(t):
        raise BeamdaeError(
            f"{forces.beam.name}: t must be one of the times of the forces, {forces.t[0]:g} to "
            f"{forces.t[-1]:g} s, got {t:g}."
        )
    return row
