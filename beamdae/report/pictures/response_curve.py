"""Pictures of response curves: how far a column swings over the parameter, stable or not."""

from __future__ import annotations

import numpy as np

from beamdae.report.pictures.figures import COLORS, disable_math_text
from beamdae.results.displays import Plot
from beamdae.results.frequency_response import FrequencyResponse
from beamdae.results.headers import Header


def plot_response(response: FrequencyResponse, column: str) -> Plot:
    """Half the range of an observed column over the parameter; dashed where it is unstable."""
    # Here, for it takes longer to import than some commands to run.
    from matplotlib.figure import Figure

    values, sizes = response.curve(column)
    stable = np.array([point.stable for point in response.points], bool)
    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    axes = figure.add_subplot()
    # A stretch is as stable as its beginning, and reaches to the next.
    cuts = np.flatnonzero(np.diff(stable)) + 1
    for part in np.split(np.arange(len(values)), cuts):
        if len(part):
            own = slice(part[0], part[-1] + 2)
            look = "-" if stable[part[0]] else "--"
            axes.plot(values[own], sizes[own], look, color=COLORS[0], lw=1.6)
    for value, size in response.peaks(column):
        axes.plot(value, size, "o", color=COLORS[1], ms=4)
    axes.set_xlabel(response.parameter)
    unit = Header.of(column).unit if response.points else ""
    axes.set_ylabel(f"{column.removesuffix(f' [{unit}]')}, half range [{unit}]")
    axes.grid(color="0.9", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    disable_math_text(figure)
    return Plot(figure)
