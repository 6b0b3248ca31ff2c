"""HTML pages with tables, charts and animations that open offline."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from importlib.resources import files
from importlib.resources.abc import Traversable
from operator import methodcaller
from pathlib import Path
from typing import Any
from urllib.parse import quote

from beamdae.errors import BeamdaeError
from beamdae.report.option_names import name_options
from beamdae.report.page.page_content import PageContent
from beamdae.report.page.page_data import (
    encode_curves,
    encode_frames,
    replace_nonfinite,
    write_curves,
)
from beamdae.report.text import make_printable
from beamdae.results.storage.files import write_text

# Files in the order of concatenation; all scripts share one global scope.
_STYLES = ("page", "charts", "tables", "mechanism", "media")
_SCRIPTS = (
    "decoding",
    "elements",
    "numbers",
    "markers",
    "chart",
    "cases",
    "curve_files",
    "scatter",
    "curves",
    "mechanism",
    "player",
    "sliders",
    "fact_tables",
    "case_table",
    "selection",
    "main",  # must be last because it initializes the page
)

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
# Python number of a NumPy scalar, which JSON does not know.
_TO_NUMBER = methodcaller("item")
_FILE_SOURCES = " 'self' file:"
_CURVE_FILE_NAME = re.compile(r"curves_\d+\.js")


def write_page(path: Path, page: PageContent) -> Path:
    """Write tables, charts and animations of runs to one HTML file that opens offline.

    Parameters
    ----------
    path
        Path of the HTML file.
    page
        Content of the page; see `PageContent`.

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
    blocks, folder = content["curve_files"], _curve_folder(path)
    if blocks and folder.is_symlink():
        raise BeamdaeError(f"{folder}: the path must be a folder, but is a link; remove the link.")
    remove_curve_files(path)
    names = [f"curves_{k}.js" for k in range(len(blocks))]
    for name, create_curves in zip(names, blocks, strict=True):
        write_curves(folder / name, create_curves())
    content["curve_files"] = [f"{quote(folder.name)}/{name}" for name in names]
    sources = _FILE_SOURCES if blocks else ""
    library = files("beamdae.report.page").joinpath("library", "echarts.min.js").read_text("utf-8")
    texts = {"title": title, "sources": sources, "library": library}
    page_text = fill_template("page", _STYLES, _SCRIPTS, content, **texts)
    write_text(path, page_text)
    return path


def _curve_folder(page: Path) -> Path:
    # With their suffix, a.html, a.htm and a have different folders.
    name = page.stem if page.suffix == ".html" else f"{page.stem}{page.suffix or '.'}"
    return page.with_name(f"{name}_curves")


def list_page_files(page: Path) -> list[Path]:
    """Return the page and, if it loads curves from files, their folder."""
    folder = _curve_folder(page)
    return [page, folder] if folder.is_dir() and not folder.is_symlink() else [page]


def remove_curve_files(page: Path) -> None:
    """Remove the files of curves of an earlier page, and their folder if it is empty then.

    A link in place of the folder is not followed.
    """
    folder = _curve_folder(page)
    if folder.is_symlink():
        return
    with suppress(OSError):
        for file in folder.iterdir():
            if _CURVE_FILE_NAME.fullmatch(file.name):
                file.unlink()
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
    json_text = json.dumps(data, default=_TO_NUMBER, allow_nan=False, separators=(",", ":"))
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
    return "\n".join((folder / f"{n}{suffix}").read_text(encoding="utf-8") for n in names)


def _complete_page(content: PageContent) -> dict[str, Any]:
    """Add default entries, encode curves and frames, and replace non-finite numbers with None."""
    page = {**_PAGE_DEFAULTS, **content}
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
    completed: dict[str, Any] = replace_nonfinite(page)
    return completed


def _collect_unique_ids(kind: str, entries: Iterable[Mapping[str, Any]]) -> set[str]:
    ids: set[str] = set()
    for entry in entries:
        if entry["id"] in ids:
            raise BeamdaeError(
                f"page: the id {entry['id']!r} of a {kind} is used twice; use different ids."
            )
        ids.add(entry["id"])
    return ids
