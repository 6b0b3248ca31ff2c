"""Response plots of a sweep: what is told of its runs over one parameter, or over two."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError, short_repr, suggest
from beamdae.report.pictures import figures as pictures
from beamdae.report.text import shorten_text
from beamdae.results.displays import Plot
from beamdae.studies.sweeps.responses import STATUS, Panel, parameter_column
from beamdae.studies.sweeps.sweep import format_setting

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from beamdae.studies.sweeps.sweep_results import SweepResults

Array = np.ndarray

# Ticks of an axis, letters of one, and letters below a panel.
_MOST_TICKS, _NAME, _ROOM = 12, 18, 48


@dataclass(frozen=True)
class Scale:
    """A parameter on an axis.

    Attributes
    ----------
    name
        Of the parameter.
    at
        Where each row of the table has its place.
    places
        The places there are, in order.
    labels
        Of places of what is no number; none for numbers.
    log
        Whether its values are of a constant ratio.
    """

    name: str
    at: Array
    places: Array
    labels: tuple[str, ...]
    log: bool

    @classmethod
    def of(cls, swept: SweepResults, name: str) -> Scale:
        """The scale of a parameter: numbers as they are, other values in the order they come in."""
        values = list(swept.table[parameter_column(swept.sweep, name)])
        if _are_numbers(values):
            at = np.array(values, float)
            places = np.unique(at)
            return cls(name, at, places, (), _is_geometric(places))
        told = [str(value) for value in values]
        order = list(dict.fromkeys(told))
        at = np.array([order.index(one) for one in told], float)
        return cls(name, at, np.arange(len(order), dtype=float), tuple(order), False)

    def dress(self, axes: Axes, which: str) -> None:
        """Name, scale and ticks of the "x" or the "y" axis."""
        axis = getattr(axes, f"{which}axis")
        axis.set_label_text(shorten_text(self.name, pictures.MAX_LABEL_LETTERS))
        if self.log:
            getattr(axes, f"set_{which}scale")("log")
        spread = np.linspace(0, len(self.places) - 1, _MOST_TICKS).round().astype(int)
        chosen = self.places[np.unique(spread)]
        # What stands beside each other shares the room there is.
        room = _ROOM // len(chosen) - 2 if which == "x" else _NAME
        if self.labels:
            names = [shorten_text(self.labels[int(k)], _NAME) for k in chosen]
            wide = max(map(len, names)) > room
            axis.set_ticks(chosen, names, **({"rotation": 30, "ha": "right"} if wide else {}))
            return
        names = [format_setting(float(x)) for x in chosen]
        even = len(self.places) <= _MOST_TICKS // 2 or self.log
        if even and len(chosen) == len(self.places) and max(map(len, names)) <= room:
            axis.set_ticks(chosen, names)
            axis.set_ticks([], minor=True)

    def edges(self) -> Array:
        """Ends of the cells around the places."""
        x = np.log(self.places) if self.log else self.places
        if len(x) == 1:
            found = np.array([x[0] - 0.5, x[0] + 0.5])
        else:
            middles = 0.5 * (x[1:] + x[:-1])
            found = np.array([1.5 * x[0] - 0.5 * x[1], *middles, 1.5 * x[-1] - 0.5 * x[-2]])
        return np.exp(found) if self.log else found


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(x, (int, float, np.number)) and not isinstance(x, (bool, np.bool_))
               for x in values)  # fmt: skip


def _is_geometric(places: Array) -> bool:
    if len(places) < 3 or places[0] <= 0.0:
        return False
    ratios = places[1:] / places[:-1]
    return bool(np.allclose(ratios, ratios[0], rtol=1e-6))


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from beamdae.studies.sweeps.sweep_results import SweepResults


# Curves a picture has names for.
_MAX_LEGEND_CURVES = 24
# Of two parameters fewer of all pairs are drawn as dots.
_MIN_MAP_COVERAGE = 0.5
_FAILURE_STYLE: dict[str, Any] = {"marker": "x", "color": "0.2", "ms": 6, "ls": "none", "mew": 1.5}


def list_response_plots(swept: SweepResults, folder: Path) -> dict[str, Callable[[], list[Path]]]:
    """What draws the response plots of a sweep as PNG and SVG, by name."""
    panels = swept.panels()
    if not swept.sweep.varied or not panels:
        return {}
    found: dict[str, Callable[[], list[Path]]] = {
        "response": partial(_save_files, partial(plot_curves, swept, panels), folder / "response")
    }
    if len(swept.sweep.varied) == 2:
        found["map"] = partial(_save_files, partial(plot_maps, swept, panels), folder / "map")
    return found


def _save_files(draw: Callable[[], Plot], path: Path) -> list[Path]:
    figure = draw().figure
    return [pictures.save_figure(figure, path.with_suffix(suffix)) for suffix in (".png", ".svg")]


def plot_curves(swept: SweepResults, panels: Sequence[Panel], x: str | None = None) -> Plot:
    """A panel each, over a parameter: a curve for each choice of the others."""
    scale = Scale.of(swept, choose_axis(swept, x))
    families = group_rows(swept, scale.name)
    several = len(families) > 1
    if several:
        panels = [one for panel in panels for one in panel.apart()]
    panels = _remove_empty(swept.table, panels)
    labels = list(families) if several else _list_measures(panels)
    styles = _create_styles(labels, several and _is_graded(swept, scale.name, len(families)))
    figure, axes = pictures.create_panels(len(panels), "")
    for axis, panel in zip(axes, panels, strict=False):
        for family, rows in families.items():
            for what, column in panel.lines.items():
                style = styles.get(family if several else what, {"color": pictures.COLORS[0]})
                _draw_curve(axis, swept.table, scale, rows, column, style)
        _mark_failures(axis, swept, scale)
        pictures.format_axis(
            axis, shorten_text(panel.title, pictures.MAX_LABEL_LETTERS), _format_unit(panel)
        )
        axis.margins(x=0.04)
        scale.dress(axis, "x")
    _add_legend(
        figure, styles if len(labels) > 1 else {}, bool((swept.table[STATUS] != "ok").any())
    )
    pictures.disable_math_text(figure)
    return Plot(figure)


def _extract_numbers(column: pd.Series) -> Array:
    """What of a column an axis has a place for."""
    values = pd.to_numeric(column, "coerce").to_numpy(float)
    return pictures.mask_huge_values({"": values})[""]


def _remove_empty(table: pd.DataFrame, panels: Sequence[Panel]) -> list[Panel]:
    """Those with something to draw."""
    known = {
        c: not np.isnan(_extract_numbers(table[c])).all() for x in panels for c in x.lines.values()
    }
    return [x for x in panels if any(known[c] for c in x.lines.values())]


def _is_graded(swept: SweepResults, x: str, families: int) -> bool:
    """Whether the curves are those of many numbers."""
    others = [name for name in swept.sweep.varied if name != x]
    many = families > len(pictures.COLORS)
    return many and len(others) == 1 and not Scale.of(swept, others[0]).labels


def _add_legend(figure: Figure, styles: dict[str, dict[str, Any]], missed: bool) -> None:
    entries = dict(list(styles.items())[:_MAX_LEGEND_CURVES])
    if len(styles) > _MAX_LEGEND_CURVES:
        entries[f"and {len(styles) - _MAX_LEGEND_CURVES} more"] = {"ls": "none"}
    if missed:
        entries["did not reach its end"] = _FAILURE_STYLE
    if entries:
        pictures.add_legend(figure, entries)


def _format_unit(panel: Panel) -> str:
    return f"[{panel.unit}]" if panel.unit else ""


def plot_maps(
    swept: SweepResults, panels: Sequence[Panel], x: str | None = None, y: str | None = None
) -> Plot:
    """A panel each, in color over two parameters."""
    varied = swept.sweep.varied
    if len(varied) != 2:
        raise BeamdaeError(
            f"{swept.sweep.name}: a map is drawn over two parameters, and {len(varied)} vary"
            f"{': ' if varied else ''}{', '.join(varied)}."
        )
    across = Scale.of(swept, choose_axis(swept, x))
    (other,) = [name for name in varied if name != across.name]
    if y is not None and choose_axis(swept, y) != other:
        raise BeamdaeError(f"{swept.sweep.name}: x and y must be the two parameters that vary.")
    up = Scale.of(swept, other)
    chosen = _remove_empty(swept.table, [one for panel in panels for one in panel.apart()])
    figure, axes = pictures.create_panels(len(chosen), "")
    for axis, panel in zip(axes, chosen, strict=False):
        (column,) = panel.lines.values()
        pictures.format_axis(axis, shorten_text(panel.title, pictures.MAX_LABEL_LETTERS), "")
        _draw_map(axis, across, up, _extract_numbers(swept.table[column]))
        axis.figure.axes[-1].set_ylabel(_format_unit(panel))
        across.dress(axis, "x")
        up.dress(axis, "y")
    pictures.disable_math_text(figure)
    return Plot(figure)


def choose_axis(swept: SweepResults, asked: Any) -> str:
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


def group_rows(swept: SweepResults, x: str) -> dict[str, Array]:
    """Rows of the table by what they have of the other parameters."""
    others = [name for name in swept.sweep.varied if name != x]
    found: dict[str, list[int]] = {}
    for k, told in enumerate(swept.sweep.settings):
        found.setdefault(", ".join(f"{o}={format_setting(told[o])}" for o in others), []).append(k)
    return {family: np.array(rows) for family, rows in found.items()}


def _list_measures(panels: Sequence[Panel]) -> list[str]:
    return list(dict.fromkeys(what for panel in panels for what in panel.lines if what))


def _create_styles(labels: Sequence[str], graded: bool) -> dict[str, dict[str, Any]]:
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


def _draw_curve(
    axis: Axes, table: pd.DataFrame, scale: Scale, rows: Array, column: str, style: dict[str, Any]
) -> None:
    """One curve in the order of the parameter; what is no number is not joined."""
    rows = rows[np.argsort(scale.at[rows], kind="stable")]
    heights = _extract_numbers(table[column])[rows]
    look: dict[str, Any] = {"marker": "o", "ms": 3.5, "lw": 1.4} | style
    if scale.labels:
        look |= {"ls": "none", "ms": 6}
    axis.plot(scale.at[rows], heights, **look)


def _mark_failures(axis: Axes, swept: SweepResults, scale: Scale) -> None:
    """Marks below the curves where runs did not reach their end."""
    at = np.unique(scale.at[(swept.table[STATUS] != "ok").to_numpy()])
    axis.plot(at, np.full(len(at), 0.02), transform=axis.get_xaxis_transform(), **_FAILURE_STYLE)


def _draw_map(axis: Axes, x: Scale, y: Scale, heights: Array) -> None:
    """Colors over two parameters: cells, or dots where few pairs were run."""
    cells = np.full((len(y.places), len(x.places)), np.nan)
    cells[np.searchsorted(y.places, y.at), np.searchsorted(x.places, x.at)] = heights
    missed = np.isnan(heights)
    look: dict[str, Any] = {"cmap": "viridis"}
    if len(heights) < _MIN_MAP_COVERAGE * cells.size:
        drawn: Any = axis.scatter(x.at[~missed], y.at[~missed], c=heights[~missed], s=30, **look)
    else:
        drawn = axis.pcolormesh(x.edges(), y.edges(), cells, **look)
        if min(cells.shape) > 2 and not (x.labels or y.labels or np.isnan(cells).any()):
            axis.contour(x.places, y.places, cells, colors="white", linewidths=0.7)
    axis.plot(x.at[missed], y.at[missed], **_FAILURE_STYLE)
    axis.grid(False)
    axis.figure.colorbar(drawn, ax=axis)
