"""One self-contained HTML file: tables, charts and animations a browser opens offline."""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from beamdae.errors import BeamdaeError
from beamdae.report.page.page_data import encode_curves, encode_frames
from beamdae.report.text import make_printable
from beamdae.results.storage.files import write_text


def fill_template(
    name: str, styles: Sequence[str], scripts: Sequence[str], data: Mapping[str, Any], **texts: str
) -> str:
    """A template of this folder with everything it refers to in it."""
    folder = files("beamdae.report.page")
    written = json.dumps(data, allow_nan=False, separators=(",", ":"))
    parts = {
        "style": _join_files(folder / "style", styles, ".css"),
        "script": _join_files(folder / "script", scripts, ".js"),
        # No tag can begin within the data.
        "data": written.replace("<", "\\u003c"),
        **texts,
    }
    template = folder.joinpath(f"{name}.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def _join_files(folder: Traversable, names: Sequence[str], suffix: str) -> str:
    return "\n".join((folder / f"{n}{suffix}").read_text(encoding="utf-8") for n in names)


# Each once in the page, one after the other: what they define is known to all of them.
_STYLES = ("page", "charts", "table", "mechanism", "screens")
_SCRIPTS = (
    "data",
    "elements",
    "numbers",
    "marks",
    "axes",
    "gestures",
    "saving",
    "chart",
    "cases",
    "scatter",
    "unplotted",
    "curves",
    "reading",
    "mechanism",
    "player",
    "facts",
    "table",
    "selection",
    # It begins.
    "page",
)

_GROUP: dict[str, Any] = {"label": "", "reference": None, "frames": None}
_TABLE: dict[str, Any] = {"title": "", "head": [], "rows": []}
_CASE: dict[str, Any] = {
    "label": "",
    "family": "",
    "series": None,
    "rank": None,
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
    "axes": {},
    "tables": [],
    "cases": [],
}


def write_page(path: Path, page: Mapping[str, Any]) -> Path:
    """Write runs, and what is known of them, as one HTML file that needs nothing else.

    Parameters
    ----------
    path
        Of the HTML file.
    page
        Plain values, every entry but the ids may be missing:

        - "title", "subtitle"; "made", versions by name; "notes", sentences.
        - "groups", cases that are looked at together, such as those of the same parameters: "id",
          "label"; "reference", what their errors are measured against, with "methods",
          "uncertainty" (the least error it resolves), "accepted" and "sentence", or None;
          "frames", what moves, as `beamdae.report.scene.frame_export.export_run_frames` returns it.
        - "columns" of the case table: "key", "label", "unit" and "kind", one of "text", "number",
          "status", "error" and "cost"; the last two show the entries of a case with these names.
          The label of a case (key "label") and its status come first, named or not.
        - "axes", keys "x" and "y" of the columns cases are drawn by first; by any two of numbers
          they can be. Default: error over cost, where there are any.
        - "tables" of facts: "title", "head" (names of columns) and "rows".
        - "cases": "id", "group", "label", "family" (its color and its entry in the legend, such as
          the integrator or other parameters), "series" (cases of the same are joined by a line;
          default none), "rank" (a number: the order in which they are, and in which they are sorted
          by their label), "status" ("ok" or a sentence), "values" by column,
          "error", "cost" [s], "below" (the error is less than the reference resolves), "limited"
          (stopped by a limit), "curves" as `beamdae.report.page.page_data.select_curves` has them: "t" [s]
          and over it "observed" by name, "error", "energy" by name ("imbalance" is drawn by its
          size), "position drift", "velocity drift", and "difference", to the reference, with
          "observed" and "energy" by name.

        A page of one case without columns is that of a run: it has no table of cases, and the
        first of its tables stands beside its motion.

    Returns
    -------
    Path
        Of the HTML file.

    Raises
    ------
    BeamdaeError
        If an id is taken, a case belongs to no group or the file cannot be written.
    """
    return write_text(path, _fill_page(_complete_page(page)))


def _fill_page(page: Mapping[str, Any]) -> str:
    """The template with everything it refers to in it."""
    title = html.escape(make_printable(page["title"]))
    return fill_template("page", _STYLES, _SCRIPTS, page, title=title)


def _complete_page(page: Mapping[str, Any]) -> dict[str, Any]:
    """The page with all its entries, its curves in their stored form."""
    page = {**_PAGE, **page}
    groups = [_GROUP | group for group in page["groups"]]
    group_ids = _require_unique_ids("group", groups)
    cases = [_CASE | case for case in page["cases"]]
    _require_unique_ids("case", cases)
    for case in cases:
        if case.get("group") not in group_ids:
            raise BeamdaeError(f"page: the case {case['id']!r} belongs to no group.")
    page["tables"] = [_TABLE | table for table in page["tables"]]
    page["groups"] = [group | {"frames": encode_frames(group["frames"])} for group in groups]
    page["cases"] = [case | {"curves": encode_curves(case["curves"])} for case in cases]
    return _replace_nonfinite(page)


def _require_unique_ids(kind: str, entries: Iterable[Mapping[str, Any]]) -> set[str]:
    """The ids of the entries."""
    known: set[str] = set()
    for entry in entries:
        if entry["id"] in known:
            raise BeamdaeError(f"page: the id {entry['id']!r} of a {kind} is taken.")
        known.add(entry["id"])
    return known


def _replace_nonfinite(value: Any) -> Any:
    """The value with None for every number that is not finite."""
    if isinstance(value, Mapping):
        return {str(name): _replace_nonfinite(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_replace_nonfinite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
