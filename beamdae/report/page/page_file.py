"""HTML pages with tables, charts and animations that open offline."""

from __future__ import annotations

import hashlib
import html
import json
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any
from urllib.parse import quote

from beamdae.errors import BeamdaeError
from beamdae.report.option_names import name_options
from beamdae.report.page.page_data import encode_curves, encode_frames
from beamdae.report.text import make_printable
from beamdae.results.storage.files import versions, write_text

# Files in the order of concatenation; all scripts share one global scope.
_STYLES = ("page", "charts", "tables", "mechanism", "media")
_SCRIPTS = (
    "decoding",
    "elements",
    "numbers",
    "markers",
    "axes",
    "gestures",
    "export",
    "chart",
    "cases",
    "curve_files",
    "labels",
    "scatter",
    "curves",
    "cursor",
    "mechanism",
    "player",
    "sliders",
    "map",
    "portrait",
    "profile",
    "fact_tables",
    "case_table",
    "selection",
    "print",
    "main",  # must be last because it initializes the page
)

# Scripts that only pages with this entry contain.
_OPTIONAL_SCRIPTS = {"labels": "overlays", "profile": "profiles"}

# Lines that begin with a comment, after indentation is removed.
_COMMENT_LINES = re.compile(r"^(//.*|/\*[^*]*(\*(?!/)[^*]*)*\*/)\n", re.MULTILINE)

# Comments at the ends of lines. Texts between quotation marks are not comments.
_END_COMMENTS = re.compile(r"(?<=\S) +// [^\"'`\n]*$", re.MULTILINE)

_STYLE_LINE_ENDS = re.compile(r"(?<=[;{}])\n")

# Default values of optional entries.
_GROUP_DEFAULTS: dict[str, Any] = {"label": "", "reference": None, "frames": None}
_TABLE_DEFAULTS: dict[str, Any] = {"title": "", "head": [], "rows": [], "section": "results"}
_CASE_DEFAULTS: dict[str, Any] = {
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
    "frames": None,
    "at": None,
    "file": "",
}
_PAGE_DEFAULTS: dict[str, Any] = {
    "title": "",
    "subtitle": "",
    "made": {},
    "notes": [],
    "groups": [],
    "columns": [],
    "axes": {},
    "sliders": [],
    "map": None,
    "sequential": False,
    "families": [],
    "time": {},
    "portrait": None,
    "views": {},
    "overlays": [],
    "leads": False,
    "featured": [],
    "profiles": [],
    "noun": "cases",
    "tables": [],
    "cases": [],
    "curve_files": [],
}

# Sources of scripts, in addition to those in the page: files beside the page, opened from a folder
# or from a server.
_FILE_SOURCES = " 'self' file:"
_CURVE_FILE = re.compile(r"// SHA-256 (?P<checksum>[0-9a-f]{64})\n(?P<script>.*)", re.DOTALL)
_CURVE_FILE_NAME = re.compile(r"curves_[0-9a-f]{16}\.js")


@dataclass(frozen=True)
class CurveBlock:
    """Curves of some cases, which a page loads from a file beside it when one is selected.

    A page that is opened from a folder may load scripts but no data, so the file is a script.

    Attributes
    ----------
    ids
        Identifiers of the cases.
    key
        Text that changes if the curves change; an existing file with the same key is kept, unless
        it is damaged.
    create
        Function that returns the curves by identifier, as returned by
        `beamdae.report.page.page_data.select_curves`.
    """

    ids: tuple[str, ...]
    key: str
    create: Callable[[], Mapping[str, Mapping[str, Any] | None]]

    @property
    def name(self) -> str:
        """Name of the file."""
        text = json.dumps([versions(), self.ids, self.key])
        return f"curves_{_compute_checksum(text)[:16]}.js"

    def write(self, folder: Path) -> None:
        """Write the file, unless it exists and is undamaged."""
        path = folder / self.name
        if _is_undamaged(path):
            return
        curves = {name: encode_curves(x) for name, x in self.create().items()}
        text = json.dumps(_replace_nonfinite(curves), allow_nan=False, separators=(",", ":"))
        # As text, because "__proto__" as a name in a script is not a name of a quantity.
        script = f"addCurves({json.dumps(text)});\n"
        write_text(path, f"// SHA-256 {_compute_checksum(script)}\n{script}")


def _is_undamaged(path: Path) -> bool:
    """Return True if a file of curves exists and its checksum is correct."""
    if not path.is_file():
        return False
    try:
        content = _CURVE_FILE.fullmatch(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        return False
    return content is not None and _compute_checksum(content["script"]) == content["checksum"]


def _compute_checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def write_page(path: Path, page: Mapping[str, Any]) -> Path:
    """Write tables, charts and animations of runs to one HTML file that opens offline.

    Parameters
    ----------
    path
        Path of the HTML file.
    page
        Plain values. All entries are optional except "id", the "group" of a case, and the entries
        of a column:

        - "title", "subtitle", "made" (versions by package name) and "notes" (list of sentences).
        - "noun": what the cases are; "cases" by default.
        - "groups": sets of cases that are compared with each other, for example cases with equal
          parameters. Entries: "id"; "label"; "reference", the reference solution for errors, with
          "methods", "uncertainty" (the smallest error that it resolves), "accepted" and "sentence",
          or None; "frames", the animation, as returned by
          `beamdae.report.scene.frame_export.export_run_frames`.
        - "columns" of the case table: "key", "label", "unit" and "kind" ("text", "number",
          "status", "error" or "cost"). Columns of the kinds "error" and "cost" show the entries
          "error" and "cost" of each case. The label of a case (key "label") and its status always
          come first. Columns with "section" equal to "solver" are hidden initially.
        - "axes": keys "x" and "y" of the columns that the scatter plot shows initially. The user
          can select error, cost and numeric columns. Defaults to error over cost if available; None
          for no scatter plot.
        - "sliders", one per swept parameter: "label", "unit", "values" (ascending), and "isNumeric"
          (the mechanism morphs between neighboring values). They select the motion, which is
          interpolated between the cases that have "frames".
        - "map": indices of the two sliders that are the axes of a map of a response, or None.
        - "families" that have the first colors and markers, in this order; with two or more, there
          is a legend even if only one of them occurs. Other families follow in the order of the
          cases.
        - "sequential": True if the families follow a parameter; their colors form a sequence.
        - "time": "name" and "unit" of the quantity that takes the place of the time, for example
          the load factor of an equilibrium path, and "log" (True for a logarithmic axis).
        - "portrait": columns "x" and "y" that a chart initially shows over each other, and "marks"
          with "t" and "label"; None for no such chart.
        - "overlays" of the scatter plot, for pairs of axes "x" and "y" (keys of columns): "lines"
          and "marks" with "label", "x" and "y" (lists of numbers for lines, numbers for marks).
        - "views": ranges that charts show first, by key of the chart ("scatter"), with "x" and "y"
          as pairs of numbers; the button "Reset" shows all.
        - "leads": True if the scatter plot is the main result, shown first beside the motion.
        - "featured": names of the observed columns that the user measured or asked for. They are
          listed first; the page opens on the first one that moves.
        - "profiles": lists of numbers that a chart shows over their index, for each selected case:
          "label", and "keys" of the numbers in the "values" of the cases.
        - "tables" of facts: "title", "head" (column names), "rows", and "section": "results"
          (default), "errors" or "solver".
        - "cases": "id"; "group"; "label"; "family", which determines color and legend entry, for
          example the integrator; "series" (cases of the same series are connected by a line;
          default None); "rank", a number that orders the cases of a series and the table by label;
          "status" ("ok" or a sentence); "values" by column; "extremes", pairs of the smallest and
          the largest value of observed columns over all steps, by header (optional); "error";
          "cost" [s]; "below" (True if the error is below the resolution of the reference);
          "limited" (True if a limit stopped the run); "dashed" (True if lines to it are dashed);
          "at" (index of its value for each slider); "frames", its own animation, or
          None; "points" (True for measured data, which are drawn as points and
          selected with their model when the page opens); "file" (name of the file with its rows);
          and "curves", as returned by
          `beamdae.report.page.page_data.select_curves`; or "block", the index of an entry of
          "curve_files", from which the curves are loaded when the case is selected.
          Entries of "curves": "t" [s]; at these times "observed" by name, "magnitude" and "phase"
          of a transfer function by name (with frequencies as "t"), "error", "energy" by name
          (the magnitude of "imbalance" is drawn), "position drift", "velocity drift"; and
          "difference" from the reference, with "observed" and "energy" by name.
        - "curve_files": list of `CurveBlock`, written to a folder beside the page that has the name
          of the page, without ".html", and "_curves".

        A page with one case and without columns is the page of a run: it has no case table. The
        order of every page is motion, curves, results, error budget, solver.

    Returns
    -------
    Path
        Path of the HTML file.

    Raises
    ------
    BeamdaeError
        If two groups or two cases have the same id, a case refers to an unknown group, the folder
        of the curves is a link, or a file cannot be written.
    """
    title = html.escape(make_printable(page.get("title", "")))
    content = _complete_page(page)
    content["notes"] = [name_options(sentence) for sentence in content["notes"]]
    blocks = content["curve_files"]
    folder = _curve_folder(path)
    content["curve_files"] = [f"{quote(folder.name)}/{block.name}" for block in blocks]
    sources = _FILE_SOURCES if blocks else ""
    if blocks and folder.is_symlink():
        raise BeamdaeError(f"{folder}: the path must be a folder, but is a link; remove the link.")
    for block in blocks:
        block.write(folder)
    scripts = [x for x in _SCRIPTS if x not in _OPTIONAL_SCRIPTS or content[_OPTIONAL_SCRIPTS[x]]]
    page_text = fill_template("page", _STYLES, scripts, content, title=title, sources=sources)
    write_text(path, page_text)
    remove_curve_files(path, {block.name for block in blocks})
    return path


def _curve_folder(page: Path) -> Path:
    # With their suffix, a.html, a.htm and a have different folders.
    name = page.stem if page.suffix == ".html" else f"{page.stem}{page.suffix or '.'}"
    return page.with_name(f"{name}_curves")


def list_page_files(page: Path) -> list[Path]:
    """Return the page and, if it loads curves from files, their folder."""
    folder = _curve_folder(page)
    return [page, folder] if folder.is_dir() and not folder.is_symlink() else [page]


def remove_curve_files(page: Path, used: Collection[str] = ()) -> None:
    """Remove the files of curves of an earlier page, and their folder if it is empty then.

    A link in place of the folder is not followed.
    """
    folder = _curve_folder(page)
    if folder.is_symlink():
        return
    with suppress(OSError):
        for file in folder.iterdir():
            if _CURVE_FILE_NAME.fullmatch(file.name) and file.name not in used:
                file.unlink()
        if not used:
            folder.rmdir()


def fill_template(
    name: str, styles: Sequence[str], scripts: Sequence[str], data: Mapping[str, Any], **texts: str
) -> str:
    """Return an HTML template of this folder with styles, scripts, data and texts inserted.

    Parameters
    ----------
    name
        Name of the template file without suffix.
    styles, scripts
        Names of files in `style/` and `script/` without suffix, in the order of insertion.
    data
        Plain values, inserted as JSON.
    **texts
        HTML for further placeholders, by placeholder name.
    """
    folder = files("beamdae.report.page")
    json_text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    parts = {
        "style": _join_files(folder / "style", styles, ".css"),
        "script": _join_files(folder / "script", scripts, ".js"),
        # Escaped so that no text in the data can close the script element.
        "data": json_text.replace("<", "\\u003c"),
        **texts,
    }
    template = folder.joinpath(f"{name}.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def _join_files(folder: Traversable, names: Sequence[str], suffix: str) -> str:
    """Return the content of scripts or styles without indentation, empty lines and comments."""
    text = "\n".join((folder / f"{n}{suffix}").read_text(encoding="utf-8") for n in names)
    lines = _COMMENT_LINES.sub("", re.sub(r"^\s+", "", text, flags=re.MULTILINE))
    # Only scripts need the ends of lines.
    return _END_COMMENTS.sub("", lines) if suffix == ".js" else _STYLE_LINE_ENDS.sub("", lines)


def _complete_page(page: Mapping[str, Any]) -> dict[str, Any]:
    """Add default entries, encode curves and frames, and replace non-finite numbers with None."""
    page = {**_PAGE_DEFAULTS, **page}
    groups = [_GROUP_DEFAULTS | group for group in page["groups"]]
    cases = [_CASE_DEFAULTS | case for case in page["cases"]]
    group_ids = _collect_unique_ids("group", groups)
    _collect_unique_ids("case", cases)
    for case in cases:
        if case.get("group") not in group_ids:
            raise BeamdaeError(
                f"page: case {case['id']!r} refers to the unknown group "
                f"{case.get('group')!r}; add the group or correct the name."
            )
    page["tables"] = [_TABLE_DEFAULTS | table for table in page["tables"]]
    page["groups"] = [group | {"frames": encode_frames(group["frames"])} for group in groups]
    page["cases"] = [
        case | {"curves": encode_curves(case["curves"]), "frames": encode_frames(case["frames"])}
        for case in cases
    ]
    return _replace_nonfinite(page)


def _collect_unique_ids(kind: str, entries: Iterable[Mapping[str, Any]]) -> set[str]:
    ids: set[str] = set()
    for entry in entries:
        if entry["id"] in ids:
            raise BeamdaeError(
                f"page: the id {entry['id']!r} of a {kind} is used twice; use different ids."
            )
        ids.add(entry["id"])
    return ids


def _replace_nonfinite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(name): _replace_nonfinite(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_replace_nonfinite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
