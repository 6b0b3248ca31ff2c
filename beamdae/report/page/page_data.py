"""Curves over time and frames of an animation in the form the page stores them in."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from beamdae.equations.measures import DRIFT_COLUMNS, LEDGER_COLUMNS, TIME
from beamdae.results.columns import Header, observed_columns

# Curves are stored in 16 bits a value: a 65534th of their range, far less than a line is wide.
_LEVELS = 65534
_MISSING = 65535
# What is larger could overflow when its range is taken.
_HUGE = 1e300
# Curves that span decades: of their size it is the logarithm that is stored and drawn.
_LOGARITHMIC: dict[str, tuple[str, ...]] = {
    "observed": (),
    "error": ("error",),
    "energy": ("imbalance",),
    "drift": ("position drift", "velocity drift"),
}


def encode_frames(frames: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Times, what is seen in all frames, and what colors it may have."""
    if not frames or not frames["t"]:
        return None
    return {
        "t": _pack_values(frames["t"]),
        "bodies": [_pack_body(body) for body in frames["bodies"]],
        "poses": [
            {axis: _pack_values(x) for axis, x in pose.items()} for pose in frames.get("poses", ())
        ],
        "symbols": list(frames.get("symbols", ())),
        "colors": [_pack_color(one) for one in frames.get("colors", ())],
        "extent": frames.get("extent"),
    }


def _pack_color(colors: Mapping[str, Any]) -> dict[str, Any]:
    """A color of beams with the values of all frames one after the other."""
    values = [
        {"name": name, "values": _pack_values(np.ravel(along).tolist())}
        for name, along in colors["values"].items()
    ]
    return {**colors, "values": values}


def _pack_body(body: Mapping[str, Any]) -> dict[str, Any]:
    """A body with the points of all frames one after the other."""
    places = {axis: _pack_values(np.ravel(body[axis]).tolist()) for axis in ("x", "y")}
    told = {"name": body["name"], "kind": body["kind"], "points": len(body["x"][0])}
    # Of a trail there is one list of points, seen as far as it has come.
    return told | places | ({"frames": body["frames"]} if "frames" in body else {})


def encode_curves(curves: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Times, and by panel and name what is drawn over them."""
    if not curves:
        return None
    drift = ("position drift", "velocity drift")
    panels = {
        "observed": curves.get("observed") or {},
        "error": {"error": curves.get("error")},
        "energy": curves.get("energy") or {},
        "drift": {name: curves.get(name) for name in drift},
    }
    differences = curves.get("difference") or {}
    return {
        "t": _pack_values(curves["t"]),
        **{panel: _pack_curves(x, _LOGARITHMIC[panel]) for panel, x in panels.items()},
        "difference": {panel: _pack_curves(x) for panel, x in differences.items()},
    }


def _pack_curves(curves: Mapping[str, Any], logarithmic: Sequence[str] = ()) -> dict[str, Any]:
    """Those of the curves that there are."""
    there = {name: x for name, x in curves.items() if x is not None and len(x)}
    return {name: _pack_values(x, name in logarithmic) for name, x in there.items()}


def _pack_values(values: Sequence[float | None] | np.ndarray, log: bool = False) -> dict[str, Any]:
    """Values, or the logarithms of their sizes, as 16-bit numbers of equal steps.

    What is missing, not finite or has no logarithm is `_MISSING`.
    """
    x = np.array(values, float)
    if log:
        x = np.log10(np.abs(x), out=np.full(len(x), math.nan), where=x != 0.0)
    finite = np.abs(x) < _HUGE
    low, high = (float(f(x[finite])) if finite.any() else 0.0 for f in (np.min, np.max))
    step = (high - low) / _LEVELS or 1.0
    codes = np.full(len(x), _MISSING, "<u2")
    codes[finite] = np.round((x[finite] - low) / step)
    return {"u16": base64.b64encode(codes.tobytes()).decode(), "low": low, "step": step, "log": log}


Array = np.ndarray

# Of all curves of a page together: 2.7 bytes each, a megabyte or so.
_MOST_VALUES = 500_000
_FEWEST_ROWS, _MOST_ROWS = 200, 2000


def compute_row_limit(curves: int) -> int:
    """How many rows each of so many curves of a page may have."""
    return int(np.clip(_MOST_VALUES // max(curves, 1), _FEWEST_ROWS, _MOST_ROWS))


def select_curves(
    columns: Mapping[str, Any],
    most: int,
    error: Array | None = None,
    differences: Mapping[str, Array] | None = None,
) -> dict[str, Any] | None:
    """The curves of a run for `beamdae.report.page.page_file.write_page`.

    Parameters
    ----------
    columns
        Time and what there is over it, by header: observed columns, energies, drift.
    most
        Every so many rows are left out that these remain.
    error
        The error at each row, NaN where it is not known.
    differences
        By header, columns less those of a reference at each row.

    Returns
    -------
    dict or None
        None where there is no curve to draw.
    """
    t = np.asarray(columns[TIME], float)
    if len(t) < 2:
        return None
    chosen = np.linspace(0, len(t) - 1, min(len(t), most)).round().astype(int)

    def rows(given: Mapping[str, Any], names: Iterable[str]) -> dict[str, Array]:
        return {name: np.asarray(given[name], float)[chosen] for name in names if name in given}

    def parted(given: Mapping[str, Any]) -> dict[str, dict[str, Array]]:
        energies = rows(given, LEDGER_COLUMNS)
        return {
            "observed": rows(given, observed_columns(given)),
            "energy": {Header.of(c).suffix.replace("_", " "): x for c, x in energies.items()},
        }

    position, velocity = DRIFT_COLUMNS
    drift = rows(columns, DRIFT_COLUMNS)
    return {
        "t": t[chosen],
        **parted(columns),
        "position drift": drift.get(position),
        "velocity drift": drift.get(velocity),
        "error": None if error is None else np.asarray(error, float)[chosen],
        "difference": {} if differences is None else parted(differences),
    }
