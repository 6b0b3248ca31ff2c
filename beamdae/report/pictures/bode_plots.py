"""Bode diagrams: magnitudes and phases of transfer functions over the frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from beamdae.analysis.linear_dynamics.bode_diagram import Bode
from beamdae.report.pictures.figures import COLORS, Panel, draw_panels
from beamdae.report.pictures.tick_labels import format_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PHASE_STEPS = [1.0, 1.5, 3.0, 4.5, 9.0, 10.0]  # of ticks; 4.5 is that of 45 degrees
# Least ranges of axes.
_MIN_MAGNITUDE_RATIO, _MIN_PHASE_RANGE = 10.0, 20.0


def create_bode_figure(diagram: Bode, title: str = "") -> Figure:
    """Draw the magnitudes on the left and the phases on the right, one transfer function a row.

    Transfer functions that are zero but for rounding errors are omitted.
    """
    model, panels = diagram.model, []
    style = {"color": COLORS[0], "lw": 1.2}
    for x in diagram.transfer_functions:
        if not x.is_noise:
            name = x.name.replace(f" [{model.outputs[x.output].unit}]", "", 1)
            name = name.removesuffix(f" [{model.inputs[x.input].unit}]")
            size, phase = ((diagram.frequencies, y, style) for y in (np.abs(x.response), x.phase))
            panels.append(Panel(name, f"magnitude [{x.unit}]", [size], scales=("log", "log")))
            panels.append(Panel(name, "phase [deg]", [phase], scales=("log", "linear")))
    figure = draw_panels(panels, title, what="panels", x_label="frequency [Hz]")
    for axis in figure.axes:
        format_ticks(axis.xaxis)
    for upper, lower in zip(figure.axes[::2], figure.axes[1::2], strict=True):
        lower.locator_params(axis="y", steps=_PHASE_STEPS)
        _widen_ranges(upper, lower)
    return figure


def _widen_ranges(magnitude: Axes, phase: Axes) -> None:
    """Show at least a decade of magnitudes and 20 degrees, so that constants are drawn as such."""
    least, most = magnitude.get_ylim()
    if most < _MIN_MAGNITUDE_RATIO * least:
        center, factor = np.sqrt(least * most), np.sqrt(_MIN_MAGNITUDE_RATIO)
        magnitude.set_ylim(center / factor, center * factor)
    least, most = phase.get_ylim()
    if most - least < _MIN_PHASE_RANGE:
        center = 0.5 * (least + most)
        phase.set_ylim(center - 0.5 * _MIN_PHASE_RANGE, center + 0.5 * _MIN_PHASE_RANGE)
