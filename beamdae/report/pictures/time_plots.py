"""Plots of columns of runs over time or over another column, of one run and of a comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.equations.measures import LEDGER_COLUMNS, TIME
from beamdae.errors import (
    BeamdaeError,
    require_sequence,
    short_repr,
    unbox_scalar,
)
from beamdae.report.pictures.figures import (
    COLORS,
    DASHES,
    Panel,
    characteristic_columns,
    draw_panels,
    varying_columns,
)
from beamdae.report.text import shorten_text
from beamdae.results.columns import (
    Header,
    is_derivative,
    merge_columns,
    observed_columns,
    remove_unit,
    require_one_column,
    select_columns,
)
from beamdae.results.displays import Plot
from beamdae.results.time_series import TimeSeries

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from beamdae.report.pictures.figures import Columns

Array = np.ndarray

_TITLE_LETTERS_BESIDE_LEGEND = 22
_MAX_FALLBACK_COLUMNS = 3  # if no column characterizes a run
_DATA_COLOR = "#333333"
_DATA_MARKERS = "osD^v"  # of experiments
_MAX_DATA_MARKERS = 150  # of a panel; more would overlap and hide the curves


def plot(
    solutions: Any,
    *names: str,
    labels: Sequence[str] | None = None,
    x: str | None = None,
    data: Any = None,
    data_columns: Mapping[str, str] | None = None,
) -> Plot:
    """Plot columns of one or several runs over time or over another column.

    Each of up to 12 columns has one panel. Over another column, a dot marks the start of each run.
    Coordinates of one point, such as "tip.y" over "tip.x", have equal scales.

    Parameters
    ----------
    solutions
        A solution or a run of a sweep, or several of them.
    *names
        Headers with or without units, or names of observables or parts, which select all their
        columns; see `Solution.__getitem__`. Defaults to the columns of `data` or, without data, to
        up to three characteristic columns of the first run.
    labels
        Labels of the runs. Defaults to the labels of the integrators or of the runs of a sweep,
        numbered if they are not distinct.
    x
        Column on the horizontal axis, such as "tip.x" for the path of a point, or "tip.y" for the
        phase plot of "tip.y_dot". Defaults to time.
    data
        Measured values, plotted as markers: a table or the path of a CSV file, as in `fit`. Columns
        such as "t [ms]" and "tip.y [mm]" are converted to the units of the run. Columns that the
        runs do not contain are ignored, those of files with a warning. The time axis covers the
        data, extended by a quarter of their duration before and after them, or at most the whole
        run.
    data_columns
        Names of columns of the run for columns of `data` with other names, see `fit`.

    Returns
    -------
    Plot
        The figure, displayed by a notebook; `Plot.save` writes it to a file.

    Raises
    ------
    BeamdaeError
        If a run does not contain one of the columns, `x` selects several columns, the data cannot
        be read or contain none of the plotted columns, or the arguments are invalid.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    >>> mech.observe("ball", ball.point)
    >>> runs = [bd.simulate(mech, method, t_end=0.1) for method in (bd.Ida(), bd.Radau())]
    >>> path = bd.plot(runs, "ball.y").save("ball.png")
    """
    runs: list[TimeSeries] = [solutions]
    if not isinstance(solutions, TimeSeries):
        runs = require_sequence("plot", "solutions", solutions, "a solution or several")
    for run in runs:
        if not isinstance(run, TimeSeries):
            raise BeamdaeError(
                f"plot: each entry of solutions must be a solution, got {short_repr(run)}."
            )
    if not runs:
        raise BeamdaeError("plot: solutions must contain at least one solution, got none.")
    run_labels = _require_labels(runs, labels)
    tables = [merge_columns(run.all_columns(), run.coordinate_columns()) for run in runs]
    observed = list(runs[0].all_columns())
    selection = select_plot(list(tables[0]), observed, names, x, data, data_columns)
    return Plot(create_figure(dict(zip(run_labels, tables, strict=True)), selection, observed))


def create_figure(
    tables: Mapping[str, Mapping[str, Any]],
    selection: PlotSelection,
    observed: Sequence[str],
    title: str = "",
) -> Figure:
    """Plot the selected columns of runs, whose tables are given by label."""
    abscissa, columns, points = selection
    first = next(iter(tables.values()))
    if not columns:
        candidates = _candidates(observed, abscissa)
        columns = characteristic_columns({c: first[c] for c in candidates})
        columns = columns or candidates[:_MAX_FALLBACK_COLUMNS]
    experiments = dict.fromkeys(name for measured in points.values() for name in measured)
    marker: dict[str, Any] = {"color": _DATA_COLOR, "ls": "", "ms": 3.5, "mfc": "none"}
    # Small, translucent and behind the curves.
    dots = {"ms": 2.0, "mfc": _DATA_COLOR, "mew": 0.0, "alpha": 0.35, "zorder": 1.9}
    shapes = zip(experiments, cycle(_DATA_MARKERS), strict=False)
    markers = {name: {**marker, "marker": shape} for name, shape in shapes}
    # The numbers of colors and dashes are coprime, so that all their pairs occur.
    pairs = zip(tables, cycle(COLORS), cycle(DASHES), strict=False)
    styles = {name: {"color": color, "ls": dash, "lw": 1.4} for name, color, dash in pairs}
    panels = []
    for column in columns:
        lines: list[tuple[Any, Any, dict[str, Any]]] = []
        for label, table in tables.items():
            (x,), (y,) = (select_columns(table, c) for c in (abscissa, column))
            lines.append((table[x], table[y], styles[label]))
            if abscissa != TIME:
                start = {"color": styles[label]["color"], "marker": "o", "ms": 4}
                lines.append((np.asarray(table[x])[:1], np.asarray(table[y])[:1], start))
        measured = points.get(column, {})
        is_dense = sum(len(values) for _, values in measured.values()) > _MAX_DATA_MARKERS
        for experiment, (u, v) in measured.items():
            lines.append((u, v, markers[experiment] | (dots if is_dense else {})))
        over = None if abscissa == TIME else (abscissa, column)
        panels.append(Panel(remove_unit(column), f"[{Header.of(column).unit}]", lines, over))
    entries: dict[str, dict[str, Any]] = dict(styles) if len(tables) > 1 or points else {}
    for experiment, marker in markers.items():
        label = f"data, {experiment}" if experiment else "data"
        while label in entries:
            label = f"measured {label}"  # A run has this label.
        entries[label] = marker
    return draw_panels(panels, title, entries, x_label=TIME if abscissa == TIME else None)


def _candidates(observed: Sequence[str], abscissa: str) -> list[str]:
    """Return the observed columns that may be plotted over `abscissa` without being named."""
    return [c for c in observed_columns(observed) if c != abscissa and not is_derivative(c)]


class PlotSelection(NamedTuple):
    """Contents of a plot.

    Attributes
    ----------
    abscissa
        Header of the column on the horizontal axis.
    columns
        Headers of the plotted columns; empty for the characteristic columns.
    points
        Measured values (k,) of the abscissa and of the column, by column and experiment; empty
        without data.
    """

    abscissa: str
    columns: list[str]
    points: dict[str, dict[str, tuple[Array, Array]]]


def select_plot(
    headers: Sequence[str],
    observed: Sequence[str],
    names: Sequence[str],
    x: str | None = None,
    data: Any = None,
    data_columns: Mapping[str, str] | None = None,
) -> PlotSelection:
    """Select the contents of a plot from the headers of the first run; see `plot`.

    Parameters
    ----------
    headers
        Headers of all columns of the run.
    observed
        Headers that take precedence if a name also selects other headers.
    names, x, data, data_columns
        See `plot`.

    Raises
    ------
    BeamdaeError
        If a name selects no column, no column is left, `x` selects several columns, or the data
        cannot be read or contain none of the plotted columns.
    """

    def select(name: str) -> list[str]:
        return select_columns(headers, name, observed=observed, part="plot")

    abscissa = TIME if x is None else require_one_column("plot", x, select(x))
    measured_columns: list[str] = []
    if data is not None:
        from beamdae.analysis.fit import data as fit_data

        given = fit_data.read_measurements("plot", data, data_columns)
        matched, unknown = fit_data.match_columns(
            "plot", given, dict.fromkeys(given.experiments, headers)
        )
        if given.is_file:
            fit_data.warn_of_columns("plot", given, matched, unknown, "the run does not have")
        measured_columns = list(matched.table["column"].unique())
    present = [x for x in measured_columns if x != abscissa]
    columns = list(dict.fromkeys(c for name in names or present for c in select(name)))
    # The name of an observable selects the abscissa, too.
    columns = [c for c in columns if x is None or c != abscissa] or columns
    points = {}
    if data is not None:
        points = {column: _pair_with(abscissa, column, matched.table) for column in columns}
    if data is not None and not any(points.values()):
        plotted = f"one of the plotted columns ({', '.join(columns)})" if columns else "a column"
        raise BeamdaeError(
            f"plot: data must contain {plotted}"
            f"{'' if abscissa == TIME else f' and {abscissa} at the same times'}; the data contain "
            f"{', '.join(measured_columns)}."
        )
    if not columns and not _candidates(observed, abscissa):
        raise BeamdaeError(
            f"plot: the run has no observed column to plot over {abscissa}; name columns, such as "
            "coordinates."
        )
    return PlotSelection(abscissa, columns, points)


def _pair_with(
    abscissa: str, column: str, measured: pd.DataFrame
) -> dict[str, tuple[Array, Array]]:
    """Return the measured values of the abscissa and of the column, by experiment."""
    pairs: dict[str, tuple[Array, Array]] = {}
    for experiment, rows in measured.groupby("experiment", sort=False):
        values = rows[rows["column"] == column].set_index(TIME)["value"]
        others = rows[rows["column"] == abscissa].set_index(TIME)["value"]
        if abscissa != TIME:
            values = values[values.index.isin(others.index)]
        if len(values):
            x = values.index if abscissa == TIME else others[values.index]
            pairs[str(experiment)] = x.to_numpy(), values.to_numpy()
    return pairs


def _require_labels(runs: Sequence[TimeSeries], labels: Any) -> list[str]:
    if labels is None:
        methods = [run.label for run in runs]
        is_repeated = len(set(methods)) < len(methods)
        return [f"{x} ({k + 1})" if is_repeated else x for k, x in enumerate(methods)]
    entries = require_sequence("plot", "labels", labels, "a text for each run")
    # Labels may be values of a parameter.
    texts = [
        label if isinstance(label, str) else short_repr(label)
        for label in map(unbox_scalar, entries)
        if isinstance(label, (str, Real))
    ]
    if len(texts) < len(entries) or len(texts) != len(runs) or len(set(texts)) < len(texts):
        raise BeamdaeError(
            f"plot: labels must contain a different label for each run ({len(runs)} in total), got "
            f"{short_repr(labels)}."
        )
    return texts


def create_motion_figure(
    motion: Any, title: str, names: Sequence[str] = (), x: str | None = None
) -> Figure | None:
    """Plot columns of one period of a `PeriodicMotion`; without names, those that vary."""
    columns = motion.solution.all_columns()
    if names or x is not None:
        selection = select_plot(list(columns), list(columns), names, x)
        return create_figure({"run": columns}, selection, list(columns), title)
    return create_run_figure(columns, title) if motion.solution.columns else None


def create_run_figure(table: Columns, title: str) -> Figure:
    """Plot observed positions, deformations and forces over time.

    Rates are omitted, and constant columns too unless all columns are constant. If no columns
    remain, energies are plotted. Columns of the same observable and unit share a panel.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    names = varying_columns(table)
    for column in names or [c for c in map(str, table) if c in LEDGER_COLUMNS]:
        header = Header.of(column)
        groups.setdefault((header.name, header.unit), []).append(column)
    panels = []
    for (name, unit), columns in groups.items():
        labels = [remove_unit(column).removeprefix(f"{name}.") for column in columns]
        colors = zip(columns, cycle(COLORS), strict=False)
        lines = [(table[TIME], table[x], {"color": color, "lw": 1.2}) for x, color in colors]
        if len(columns) > 1:
            short = shorten_text(name, _TITLE_LETTERS_BESIDE_LEGEND)
            panels.append(Panel(short, f"[{unit}]", lines, legend=labels))
        else:
            label = f"{labels[0]} [{unit}]" if labels[0] != name else f"[{unit}]"
            panels.append(Panel(name, label, lines))
    return draw_panels(panels, title, what="observables")
