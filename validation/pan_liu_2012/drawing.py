"""Panels, curves and colors of the pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, RED, GRAY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "0.6"
NONLINEAR, LINEAR = {"color": BLUE, "lw": 1.3}, {"color": RED, "lw": 1.1, "ls": (0, (5, 2))}
THIN = {"color": GRAY, "lw": 0.7}
Curves = Mapping[str, tuple[pd.Series, dict[str, Any]]]


def panels(columns: int = 1, height: float = 3.2, width: float = 5.2) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(width * columns, height), layout="constrained")
    axes = [figure.add_subplot(1, columns, k + 1) for k in range(columns)]
    for axis in axes:
        axis.grid(color="0.9", lw=0.6)
        axis.tick_params(labelsize=8)
    return figure, axes


def plot(
    axis: Axes,
    curves: Curves,
    ylabel: str,
    title: str = "",
    x: tuple[float, float, float] | None = None,
    y: tuple[float, float, float] | None = None,
) -> None:
    """Curves over time; `x`, `y` are the ends of the axes and the distance of their ticks."""
    for label, (series, style) in curves.items():
        series = series.dropna()
        axis.plot(series.index, series.to_numpy(), label=label, **style)
    axis.set_xlabel("t [s]", fontsize=9)
    axis.set_ylabel(ylabel, fontsize=9)
    axis.set_title(title, fontsize=9)
    for ends, limit, ticks in (
        (x, axis.set_xlim, axis.set_xticks),
        (y, axis.set_ylim, axis.set_yticks),
    ):
        if ends is not None:
            ticks(np.arange(ends[0], ends[1] + 0.5 * ends[2], ends[2]))
            limit(ends[0], ends[1])
    axis.legend(fontsize=7, framealpha=0.8, edgecolor="none", loc="best")


def save(figure: Figure, path: Path) -> None:
    figure.savefig(path, dpi=110)


def pick(
    table: pd.DataFrame, styles: Mapping[str, dict], pattern: str, scale: float = 1.0
) -> Curves:
    """Columns `pattern` with each label in place of {}."""
    return {label: (table[pattern.format(label)] * scale, style) for label, style in styles.items()}
