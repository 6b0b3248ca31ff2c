"""Curves over time and frames of an animation in the form the page stores them in."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

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


def stored_frames(frames: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Times, what is seen in all frames, and what colors it may have."""
    if not frames or not frames["t"]:
        return None
    return {
        "t": _packed(frames["t"]),
        "bodies": [_body(body) for body in frames["bodies"]],
        "poses": [
            {axis: _packed(x) for axis, x in pose.items()} for pose in frames.get("poses", ())
        ],
        "symbols": list(frames.get("symbols", ())),
        "colors": [_colors(one) for one in frames.get("colors", ())],
        "extent": frames.get("extent"),
    }


def _colors(colors: Mapping[str, Any]) -> dict[str, Any]:
    """A color of beams with the values of all frames one after the other."""
    values = [
        {"name": name, "values": _packed(np.ravel(along).tolist())}
        for name, along in colors["values"].items()
    ]
    return {**colors, "values": values}


def _body(body: Mapping[str, Any]) -> dict[str, Any]:
    """A body with the points of all frames one after the other."""
    places = {axis: _packed(np.ravel(body[axis]).tolist()) for axis in ("x", "y")}
    told = {"name": body["name"], "kind": body["kind"], "points": len(body["x"][0])}
    # Of a trail there is one list of points, seen as far as it has come.
    return told | places | ({"frames": body["frames"]} if "frames" in body else {})


def stored_curves(curves: Mapping[str, Any] | None) -> dict[str, Any] | None:
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
        "t": _packed(curves["t"]),
        **{panel: _named(x, _LOGARITHMIC[panel]) for panel, x in panels.items()},
        "difference": {panel: _named(x) for panel, x in differences.items()},
    }


def _named(curves: Mapping[str, Any], logarithmic: Sequence[str] = ()) -> dict[str, Any]:
    """Those of the curves that there are."""
    there = {name: x for name, x in curves.items() if x is not None and len(x)}
    return {name: _packed(x, name in logarithmic) for name, x in there.items()}


def _packed(values: Sequence[float | None] | np.ndarray, log: bool = False) -> dict[str, Any]:
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
