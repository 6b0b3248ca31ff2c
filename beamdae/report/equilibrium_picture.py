"""Pictures of equilibrium paths: the load factor over what is observed."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.report.letters import shortened
from beamdae.report.pictures import (
    AXIS,
    COLORS,
    PANELS,
    drawable,
    dressed,
    legend,
    moving,
    panels,
    saved,
)
from beamdae.results.equilibrium import Equilibrium
from beamdae.results.headers import Header

# Of the mechanism, or rad: what a panel has to show.
_STILL = 1e-9
_MARKS = {"limit point": "o", "branch point": "s", "flutter point": "^"}


def picture_of_path(path: Path, found: Equilibrium, title: str) -> Path:
    """Draw the load factor over each observed position, deformation and force.

    Stretches are dashed where the equilibrium is unstable under loads that stay; limit and branch
    points are marked. Of several stages the factors are added.

    Returns
    -------
    Path
        Of the PNG file.
    """
    columns = drawable(found.columns)
    names = [name for name in moving(columns) if _changes(found, name)][:PANELS]
    factors, unstable = found.factors.sum(axis=1), found.unstable != 0
    figure, axes = panels(len(names), title)
    for axis, name in zip(axes, names, strict=True):
        values = columns[name]
        for is_unstable, stretch in groupby(range(len(values) - 1), lambda k: unstable[k + 1]):
            rows = list(stretch)
            part = slice(rows[0], rows[-1] + 2)
            style = (0, (3, 2)) if is_unstable else "-"
            axis.plot(values[part], factors[part], color=COLORS[0], lw=1.2, ls=style)
        for one in found.critical:
            axis.plot(values[one.row], factors[one.row], **_mark(one.kind))
        dressed(axis, "", "load factor [-]")
        axis.margins(x=0.03)
        axis.set_xlabel(shortened(name, AXIS))
    entries: dict[str, dict[str, Any]] = {
        "stable": {"color": COLORS[0], "ls": "-"},
        "unstable": {"color": COLORS[0], "ls": (0, (3, 2))},
    }
    shown = {"unstable": bool(np.any(unstable[1:])), "stable": not np.all(unstable[1:])}
    entries = {name: style for name, style in entries.items() if shown[name]}
    for kind in dict.fromkeys(one.kind for one in found.critical):
        entries[kind] = _mark(kind)
    if names:
        legend(figure, entries)
    return saved(figure, path)


def _mark(kind: str) -> dict[str, Any]:
    return {"marker": _MARKS[kind], "color": COLORS[3], "ls": "", "ms": 4}


def _changes(found: Equilibrium, name: str) -> bool:
    """Whether a column is more than what rounding makes of one that stays."""
    size = {"m": found.equations.length, "rad": 1.0}.get(Header.of(name).unit, 0.0)
    return bool(found.loads) and float(np.ptp(found.columns[name])) > _STILL * size
