"""Plots of fits: data, model and residuals over time, and profile likelihoods."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.report.pictures.figures import (
    COLORS,
    Panel,
    disable_math_text,
    draw_grid,
    draw_panels,
)
from beamdae.results.columns import Header, remove_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from beamdae.analysis.fit.profile import ProfileLikelihood
    from beamdae.analysis.fit.result import Fit

_PROFILE_SIZE = (5.6, 3.6)  # [inch]
# Standard deviations between which 95 % of the residuals of a right model are.
_BAND = 1.96


def create_fit_figure(fit: Fit, title: str = "") -> Figure:
    """Plot data and model, and the residuals in standard deviations; see `Fit.plot`."""
    data: dict[str, Any] = {"color": COLORS[0], "ls": "", "marker": "o", "ms": 2.5}
    model: dict[str, Any] = {"color": COLORS[3], "lw": 1.2}
    band = {"color": "0.6", "lw": 1.0, "ls": "--"}
    panels = []
    table = fit.residual_table()
    for (experiment, column), rows in table.groupby(["experiment", "observable"], sort=False):
        time = rows["t [s]"].to_numpy()
        name, unit = remove_unit(str(column)), Header.of(str(column)).unit
        label = f"{name} in {experiment}" if experiment else name
        curves = [(time, rows["model"], model), (time, rows["value"], data)]
        limits = [(time[[0, -1]], np.full(2, x), band) for x in (-_BAND, _BAND)]
        residuals = [*limits, (time, rows["residual"], data)]
        panels += [Panel(label, f"[{unit}]", curves)]
        panels += [Panel(f"residuals of {label}", "[sigma]", residuals)]
    entries = {"data": data, "model": model, "95 % of residuals": band}
    return draw_panels(panels, title, entries)


def create_profile_figure(profile: ProfileLikelihood, title: str = "") -> Figure:
    """Plot the increase of the sum of squares over the parameter; see `ProfileLikelihood.plot`."""
    # Imported here because importing Matplotlib takes longer than some commands.
    from matplotlib.figure import Figure

    figure = Figure(figsize=_PROFILE_SIZE, layout="constrained")
    axis = figure.add_subplot()
    axis.plot(profile.values, profile.increases, "o-", color=COLORS[0], lw=1.4, ms=3)
    axis.axhline(profile.threshold, color="0.5", lw=1.0, ls="--")
    for limit in profile.interval:
        if np.isfinite(limit):
            axis.axvline(limit, color=COLORS[1], lw=1.0)
    axis.set_xlabel(profile.name)
    axis.set_ylabel("increase of chi-square")
    draw_grid(axis)
    disable_math_text(figure)
    return figure
