"""Response plots of a sweep: what is told of its runs over one parameter, or over two."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.report.pictures import figures as pictures
from beamdae.report.text import shorten_text
from beamdae.results.displays import Plot
from beamdae.studies.sweeps.scales import Scale
from beamdae.studies.sweeps.sweep import short
from beamdae.studies.sweeps.tables import STATUS, Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from beamdae.studies.sweeps.results import SweepResults

Array = np.ndarray

# Curves a picture has names for.
_MOST_CURVES = 24
# Of two parameters fewer of all pairs are drawn as dots.
_FULL = 0.5
_MISSED: dict[str, Any] = {"marker": "x", "color": "0.2", "ms": 6, "ls": "none", "mew": 1.5}


def plots(swept: SweepResults, folder: Path) -> dict[str, Callable[[], list[Path]]]:
    """What draws the response plots of a sweep as PNG and SVG, by name."""
    panels = swept.panels()
    if not swept.sweep.varied or not panels:
        return {}
    found: dict[str, Callable[[], list[Path]]] = {
        "response": partial(_files, partial(curves, swept, panels), folder / "response")
    }
    if len(swept.sweep.varied) == 2:
        found["map"] = partial(_files, partial(maps, swept, panels), folder / "map")
    return found


def _files(draw: Callable[[], Plot], path: Path) -> list[Path]:
    figure = draw().figure
    return [pictures.save_figure(figure, path.with_suffix(suffix)) for suffix in (".png", ".svg")]


def curves(swept: SweepResults, panels: Sequence[Panel], x: str | None = None) -> Plot:
    """A panel each, over a parameter: a curve for each choice of the others."""
    scale = Scale.of(swept, axis_of(swept, x))
    families = families_of(swept, scale.name)
    several = len(families) > 1
    if several:
        panels = [one for panel in panels for one in panel.apart()]
    panels = _with_numbers(swept.table, panels)
    labels = list(families) if several else _measures(panels)
    styles = _styles(labels, several and _graded(swept, scale.name, len(families)))
    figure, axes = pictures.create_panels(len(panels), "")
    for axis, panel in zip(axes, panels, strict=False):
        for family, rows in families.items():
            for what, column in panel.lines.items():
                style = styles.get(family if several else what, {"color": pictures.COLORS[0]})
                _curve(axis, swept.table, scale, rows, column, style)
        _missed(axis, swept, scale)
        pictures.format_axis(
            axis, shorten_text(panel.title, pictures.MAX_LABEL_LETTERS), _unit(panel)
        )
        axis.margins(x=0.04)
        scale.dress(axis, "x")
    _legend(figure, styles if len(labels) > 1 else {}, bool((swept.table[STATUS] != "ok").any()))
    pictures.disable_math_text(figure)
    return Plot(figure)


def _numbers_of(column: pd.Series) -> Array:
    """What of a column an axis has a place for."""
    values = pd.to_numeric(column, "coerce").to_numpy(float)
    return pictures.mask_huge_values({"": values})[""]


def _with_numbers(table: pd.DataFrame, panels: Sequence[Panel]) -> list[Panel]:
    """Those with something to draw."""
    known = {c: not np.isnan(_numbers_of(table[c])).all() for x in panels for c in x.lines.values()}
    return [x for x in panels if any(known[c] for c in x.lines.values())]


def _graded(swept: SweepResults, x: str, families: int) -> bool:
    """Whether the curves are those of many numbers."""
    others = [name for name in swept.sweep.varied if name != x]
    many = families > len(pictures.COLORS)
    return many and len(others) == 1 and not Scale.of(swept, others[0]).labels


def _legend(figure: Figure, styles: dict[str, dict[str, Any]], missed: bool) -> None:
    entries = dict(list(styles.items())[:_MOST_CURVES])
    if len(styles) > _MOST_CURVES:
        entries[f"and {len(styles) - _MOST_CURVES} more"] = {"ls": "none"}
    if missed:
        entries["did not reach its end"] = _MISSED
    if entries:
        pictures.add_legend(figure, entries)


def _unit(panel: Panel) -> str:
    return f"[{panel.unit}]" if panel.unit else ""


def maps(
    swept: SweepResults, panels: Sequence[Panel], x: str | None = None, y: str | None = None
) -> Plot:
    """A panel each, in color over two parameters."""
    varied = swept.sweep.varied
    if len(varied) != 2:
        raise BeamdaeError(
            f"{swept.sweep.name}: a map is drawn over two parameters, and {len(varied)} vary"
            f"{': ' if varied else ''}{', '.join(varied)}."
        )
    across = Scale.of(swept, axis_of(swept, x))
    (other,) = [name for name in varied if name != across.name]
    if y is not None and axis_of(swept, y) != other:
        raise BeamdaeError(f"{swept.sweep.name}: x and y must be the two parameters that vary.")
    up = Scale.of(swept, other)
    chosen = _with_numbers(swept.table, [one for panel in panels for one in panel.apart()])
    figure, axes = pictures.create_panels(len(chosen), "")
    for axis, panel in zip(axes, chosen, strict=False):
        (column,) = panel.lines.values()
        pictures.format_axis(axis, shorten_text(panel.title, pictures.MAX_LABEL_LETTERS), "")
        _map(axis, across, up, _numbers_of(swept.table[column]))
        axis.figure.axes[-1].set_ylabel(_unit(panel))
        across.dress(axis, "x")
        up.dress(axis, "y")
    pictures.disable_math_text(figure)
    return Plot(figure)


def axis_of(swept: SweepResults, asked: Any) -> str:
    """The parameter on an axis: the one asked for, or that with most values that are numbers."""
    name, varied = swept.sweep.name, swept.sweep.varied
    if not varied:
        raise BeamdaeError(f"{name}: no parameter varies, there is nothing to draw over.")
    if asked is not None:
        if not isinstance(asked, str) or asked not in varied:
            raise BeamdaeError(
                f"{name}: no parameter {short_repr(asked)}{suggest(asked, varied)} varies, but "
                f"{', '.join(varied)}."
            )
        return asked
    scales = [Scale.of(swept, one) for one in varied]
    return max(scales, key=lambda scale: (not scale.labels, len(scale.places))).name


def families_of(swept: SweepResults, x: str) -> dict[str, Array]:
    """Rows of the table by what they have of the other parameters."""
    others = [name for name in swept.sweep.varied if name != x]
    found: dict[str, list[int]] = {}
    for k, told in enumerate(swept.sweep.settings):
        found.setdefault(", ".join(f"{o}={short(told[o])}" for o in others), []).append(k)
    return {family: np.array(rows) for family, rows in found.items()}


def _measures(panels: Sequence[Panel]) -> list[str]:
    return list(dict.fromkeys(what for panel in panels for what in panel.lines if what))


def _styles(labels: Sequence[str], graded: bool) -> dict[str, dict[str, Any]]:
    """Color and dash of each curve; of many that are by numbers the color goes with the number."""
    if graded:
        from matplotlib import colormaps

        shades = colormaps["viridis"](np.linspace(0.0, 0.95, len(labels)))
        return {label: {"color": shade} for label, shade in zip(labels, shades, strict=True)}
    colors, dashes = pictures.COLORS, pictures.DASHES
    return {
        label: {"color": colors[k % len(colors)], "ls": dashes[k // len(colors) % len(dashes)]}
        for k, label in enumerate(labels)
    }


def _curve(
    axis: Axes, table: pd.DataFrame, scale: Scale, rows: Array, column: str, style: dict[str, Any]
) -> None:
    """One curve in the order of the parameter; what is no number is not joined."""
    rows = rows[np.argsort(scale.at[rows], kind="stable")]
    heights = _numbers_of(table[column])[rows]
    look: dict[str, Any] = {"marker": "o", "ms": 3.5, "lw": 1.4} | style
    if scale.labels:
        look |= {"ls": "none", "ms": 6}
    axis.plot(scale.at[rows], heights, **look)


def _missed(axis: Axes, swept: SweepResults, scale: Scale) -> None:
    """Marks below the curves where runs did not reach their end."""
    at = np.unique(scale.at[(swept.table[STATUS] != "ok").to_numpy()])
    axis.plot(at, np.full(len(at), 0.02), transform=axis.get_xaxis_transform(), **_MISSED)


def _map(axis: Axes, x: Scale, y: Scale, heights: Array) -> None:
    """Colors over two parameters: cells, or dots where few pairs were run."""
    cells = np.full((len(y.places), len(x.places)), np.nan)
    cells[np.searchsorted(y.places, y.at), np.searchsorted(x.places, x.at)] = heights
    missed = np.isnan(heights)
    look: dict[str, Any] = {"cmap": "viridis"}
    if len(heights) < _FULL * cells.size:
        drawn: Any = axis.scatter(x.at[~missed], y.at[~missed], c=heights[~missed], s=30, **look)
    else:
        drawn = axis.pcolormesh(x.edges(), y.edges(), cells, **look)
        if min(cells.shape) > 2 and not (x.labels or y.labels or np.isnan(cells).any()):
            axis.contour(x.places, y.places, cells, colors="white", linewidths=0.7)
    axis.plot(x.at[missed], y.at[missed], **_MISSED)
    axis.grid(False)
    axis.figure.colorbar(drawn, ax=axis)
