"""One self-contained HTML file of a study: tables, plots and animations a browser opens offline."""

from __future__ import annotations

import base64
import html
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.report.letters import plain
from beamdae.results.files import write_text

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

_GROUP: dict[str, Any] = {"label": "", "reference": None, "frames": None}
_CASE: dict[str, Any] = {
    "label": "",
    "family": "",
    "series": None,
    "status": "ok",
    "values": {},
    "error": None,
    "cost": None,
    "below": False,
    "limited": False,
    "curves": None,
}
_PAGE: dict[str, Any] = {
    "title": "",
    "subtitle": "",
    "made": {},
    "notes": [],
    "groups": [],
    "columns": [],
    "cases": [],
}


def write_page(path: Path, page: Mapping[str, Any]) -> Path:
    """Write a study as one HTML file that needs nothing else.

    Parameters
    ----------
    path
        Of the HTML file.
    page
        Plain values, every entry but the ids may be missing:

        - "title", "subtitle"; "made", versions by name; "notes", sentences.
        - "groups", cases that share a reference: "id", "label", "reference" with "methods",
          "uncertainty" (the least error it resolves), "accepted" and "sentence", "frames" with
          times "t" and "bodies" as `beamdae.results.shapes.shapes` gives them.
        - "columns" of the case table: "key", "label", "unit" and "kind", one of "text", "number"
          and "status". The label of a case (key "label") and its status come first, named or not.
        - "cases": "id", "group", "label", "family" (its color), "series" (what a line of the
          work-precision plot joins; default none), "status" ("ok" or a
          sentence), "values" by column, "error", "cost" [s], "below" (the error is less than the
          reference resolves), "limited" (stopped by a limit), "curves" with "t" [s] and over it
          "observed" by name, "error", "energy" by name ("imbalance" is drawn by its size),
          "position drift" and "velocity drift".

    Returns
    -------
    Path
        Of the HTML file.

    Raises
    ------
    BeamdaeError
        If an id is taken, a case belongs to no group or the file cannot be written.
    """
    return write_text(path, _rendered(_completed(page)))


def _rendered(page: Mapping[str, Any]) -> str:
    """The template with everything it refers to in it."""
    folder = files("beamdae.report.page")
    data = json.dumps(page, allow_nan=False, separators=(",", ":"))
    parts = {
        "title": html.escape(plain(page["title"])),
        "style": folder.joinpath("page.css").read_text(encoding="utf-8"),
        "script": folder.joinpath("page.js").read_text(encoding="utf-8"),
        # No tag can begin within the data.
        "data": data.replace("<", "\\u003c"),
    }
    template = folder.joinpath("page.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def _completed(page: Mapping[str, Any]) -> dict[str, Any]:
    """The page with all its entries, its curves in their stored form."""
    page = {**_PAGE, **page}
    groups = [_GROUP | group for group in page["groups"]]
    group_ids = _unique("group", groups)
    cases = [_CASE | case for case in page["cases"]]
    _unique("case", cases)
    for case in cases:
        if case.get("group") not in group_ids:
            raise BeamdaeError(f"page: the case {case['id']!r} belongs to no group.")
    page["groups"] = [group | {"frames": _frames(group["frames"])} for group in groups]
    page["cases"] = [case | {"curves": _curves(case["curves"])} for case in cases]
    return _finite(page)


def _unique(kind: str, entries: Iterable[Mapping[str, Any]]) -> set[str]:
    """The ids of the entries."""
    known: set[str] = set()
    for entry in entries:
        if entry["id"] in known:
            raise BeamdaeError(f"page: the id {entry['id']!r} of a {kind} is taken.")
        known.add(entry["id"])
    return known


def _frames(frames: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if not frames or not frames["t"]:
        return None
    return {"t": _packed(frames["t"]), "bodies": [_body(body) for body in frames["bodies"]]}


def _body(body: Mapping[str, Any]) -> dict[str, Any]:
    """A body with the points of all frames one after the other."""
    places = {axis: _packed(np.ravel(body[axis]).tolist()) for axis in ("x", "y")}
    return {"name": body["name"], "kind": body["kind"], "points": len(body["x"][0]), **places}


def _curves(curves: Mapping[str, Any] | None) -> dict[str, Any] | None:
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
    packed = {
        panel: {name: _packed(x, name in _LOGARITHMIC[panel]) for name, x in named.items() if x}
        for panel, named in panels.items()
    }
    return {"t": _packed(curves["t"]), **packed}


def _packed(values: Sequence[float | None], log: bool = False) -> dict[str, Any]:
    """Values, or the logarithms of their sizes, as 16-bit numbers of equal steps.

    What is missing, not finite or has no logarithm is `_MISSING`.
    """
    x = np.array([math.nan if value is None else value for value in values], float)
    if log:
        x = np.log10(np.abs(x), out=np.full(len(x), math.nan), where=x != 0.0)
    finite = np.abs(x) < _HUGE
    low, high = (float(f(x[finite])) if finite.any() else 0.0 for f in (np.min, np.max))
    step = (high - low) / _LEVELS or 1.0
    codes = np.full(len(x), _MISSING, "<u2")
    codes[finite] = np.round((x[finite] - low) / step)
    return {"u16": base64.b64encode(codes.tobytes()).decode(), "low": low, "step": step, "log": log}


def _finite(value: Any) -> Any:
    """The value with None for every number that is not finite."""
    if isinstance(value, Mapping):
        return {str(name): _finite(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
