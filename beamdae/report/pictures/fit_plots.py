"""Plots of fits: data, model and residuals over time, and profile likelihoods."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.report.pictures.figures import (
    COLORS,
    MAX_PANELS,
    add_legend,
    create_panels,
    disable_math_text,
    draw_grid,
    format_axis,
)
from beamdae.report.text import shorten_text
from beamdae.results.columns import Header
from beamdae.results.displays import Plot

if TYPE_CHECKING:
    from beamdae.analysis.fit.profile import ProfileLikelihood
    from beamdae.analysis.fit.result import Fit

_TITLE_LETTERS = 40
_PROFILE_SIZE = (5.6, 3.6)  # [inch]
# Standard deviations between which 95 % of the residuals of a right model are.
_BAND = 1.96


def plot_fit(fit: Fit) -> Plot:
    """Plot data and model, and the residuals in standard deviations; see `Fit.plot`."""
    table = fit.residual_table()
    series = list(table.groupby(["experiment", "observable"], sort=False))
    figure, axes = create_panels(2 * len(series), "")
    data_style: dict[str, Any] = {"color": COLORS[0], "ls": "", "marker": "o", "ms": 2.5}
    model_style: dict[str, Any] = {"color": COLORS[3], "lw": 1.2}
    for k, (key, rows) in enumerate(series[: MAX_PANELS // 2]):
        experiment, column = map(str, key)
        time = rows["t [s]"].to_numpy()
        unit = Header.of(column).unit
        name = column.removesuffix(f" [{unit}]")
        label = f"{name} in {experiment}" if experiment else name
        curves, residuals = axes[2 * k : 2 * k + 2]
        curves.plot(time, rows["model"], **model_style)
        curves.plot(time, rows["value"], **data_style)
        format_axis(curves, shorten_text(label, _TITLE_LETTERS), f"[{unit}]")
        residuals.axhspan(-_BAND, _BAND, color="0.93", lw=0.0)
        residuals.plot(time, rows["residual"], **data_style)
        format_axis(residuals, shorten_text(f"residuals of {label}", _TITLE_LETTERS), "[sigma]")
    band = {"color": "0.85", "lw": 6}
    add_legend(figure, {"data": data_style, "model": model_style, "95 % of residuals": band})
    disable_math_text(figure)
    return Plot(figure)


def plot_profile(profile: ProfileLikelihood) -> Plot:
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
    return Plot(figure)
