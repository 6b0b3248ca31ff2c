"""Curves of runs over time, for a notebook or a file."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Real
from pathlib import Path
from typing import Any

from beamdae.equations.measures import TIME
from beamdae.errors import BeamdaeError, is_valid_path, require_sequence, short_repr
from beamdae.report.pictures import figures as pictures
from beamdae.report.text import shorten_text
from beamdae.results.columns import Header, merge_columns, select_columns
from beamdae.results.displays import Plot
from beamdae.results.time_series import TimeSeries

# Letters of the name of a panel.
_NAME = 40


def picture_path(name: str, path: Any) -> Path:
    """The path of a picture to be written."""
    text = str(path) if isinstance(path, (str, Path)) else ""
    if not (is_valid_path(text) and Path(text).suffix):
        raise BeamdaeError(
            f"{name}: path must be that of a file with a suffix such as .png, got {short_repr(path)}."
        )
    return Path(text)


def plot(solutions: Any, *names: str, labels: Sequence[str] | None = None) -> Plot:
    """Draw columns of one or several runs over time, a panel a column, twelve at most.

    Parameters
    ----------
    solutions
        A solution, or several.
    names
        Headers with or without their units, or names of observables for all their columns, see
        `Solution.__getitem__`; default the columns that tell most of the first run.
    labels
        Of the runs; default their integrators.

    Returns
    -------
    Plot
        Shown by a notebook; `Plot.save` writes it to a file.

    Raises
    ------
    BeamdaeError
        If a run has no column of such a name.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    >>> mech.observe("ball", ball.point)
    >>> runs = [bd.simulate(mech, method, t_end=0.1) for method in (bd.Ida(), bd.Radau())]
    >>> path = bd.plot(runs, "ball.y").save("ball.png")
    """
    runs = _runs(solutions)
    told = _labels(runs, labels)
    tables = [merge_columns(run.all_columns(), run.coordinates()) for run in runs]
    first = runs[0].all_columns()
    wanted = names or pictures.characteristic_columns(first)
    found = (c for name in wanted for c in select_columns(tables[0], name, observed=first))
    columns = list(dict.fromkeys(found))
    figure, axes = pictures.create_panels(len(columns), "")
    looks = [
        {"color": color, "ls": dash}
        for color, dash in zip(
            pictures.repeat_styles(pictures.COLORS),
            pictures.repeat_styles(pictures.DASHES),
            strict=False,
        )
    ]
    styles = [looks[k % len(looks)] for k in range(len(runs))]
    for axis, column in zip(axes, columns, strict=False):
        for table, style in zip(tables, styles, strict=True):
            (own,) = select_columns(table, column)
            drawn = pictures.mask_huge_values({TIME: table[TIME], own: table[own]})
            time = drawn[TIME]
            axis.plot(time, drawn[own], lw=1.4, **style, **pictures.single_point_marker(time))
        header = Header.of(column)
        name = column.removesuffix(f" [{header.unit}]")
        pictures.format_axis(axis, shorten_text(name, _NAME), f"[{header.unit}]")
    if len(runs) > 1:
        lines = {label: {"lw": 1.4, **style} for label, style in zip(told, styles, strict=True)}
        pictures.add_legend(figure, lines)
    pictures.disable_math_text(figure)
    return Plot(figure)


def _runs(solutions: Any) -> list[TimeSeries]:
    found = [solutions] if isinstance(solutions, TimeSeries) else None
    found = found or require_sequence("plot", "solutions", solutions, "a solution or several")
    for one in found:
        if not isinstance(one, TimeSeries):
            raise BeamdaeError(f"plot: solutions must be solutions, got {short_repr(one)}.")
    if not found:
        raise BeamdaeError("plot: solutions must be a solution or several, got none.")
    return found


def _labels(runs: Sequence[TimeSeries], labels: Any) -> list[str]:
    if labels is None:
        own = [run.label for run in runs]
        several = len(set(own)) < len(own)
        return [f"{label} ({k + 1})" if several else label for k, label in enumerate(own)]
    told = require_sequence("plot", "labels", labels, "a text for each run")
    are_short = all(isinstance(label, (str, Real)) for label in told)
    if not are_short or len(told) != len(runs) or len(set(map(str, told))) < len(told):
        raise BeamdaeError(
            f"plot: labels must be {len(runs)} different texts, one for each run, got "
            f"{short_repr(labels)}."
        )
    return [str(label) for label in told]
