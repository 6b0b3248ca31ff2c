"""HTML pages with tables, charts and animations that open offline."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from beamdae.report.option_names import name_options
from beamdae.report.page.content import Content, encode
from beamdae.report.pictures.figures import characteristic_columns
from beamdae.report.text import make_printable
from beamdae.results.storage.files import write_text

# Files in the order of concatenation; all scripts share one global scope.
_STYLES = ("page", "charts", "tables", "mechanism", "media")
_SCRIPTS = (
    *("data", "markers", "chart", "cases", "scatter", "curves", "mechanism", "tables"),
    "main",  # must be last because it initializes the page
)

# Default values of optional entries.
_GROUP_DEFAULTS: dict[str, Any] = {"label": "", "reference": None, "frames": None}
_TABLE_DEFAULTS: dict[str, Any] = {"title": "", "head": [], "rows": [], "section": "results"}
_CASE_DEFAULTS: dict[str, Any] = {
    **dict.fromkeys(("label", "family", "file"), ""),
    **dict.fromkeys(("series", "rank", "error", "cost", "curves", "frames", "at")),
    **dict.fromkeys(("below", "limited"), False),
    "status": "ok",
    "values": {},
}
_PAGE_DEFAULTS: dict[str, Any] = {
    **dict.fromkeys(("title", "subtitle"), ""),
    **dict.fromkeys(("notes", "groups", "columns", "sliders", "families", "overlays"), ()),
    **dict.fromkeys(("tables", "cases"), ()),
    **{key: {} for key in ("made", "axes", "time", "views")},
    **dict.fromkeys(("sequential", "leads"), False),
    "noun": "cases",
    "portrait": None,
}


def write_page(path: Path, page: Content) -> Path:
    """Write tables, charts and animations of runs to one HTML file that opens offline.

    Parameters
    ----------
    path
        Path of the HTML file.
    page
        Content of the page; see `content`.

    Returns
    -------
    Path
        Path of the HTML file.

    Raises
    ------
    BeamdaeError
        If two groups or two cases have the same id, a case refers to an unknown group, or the file
        cannot be written.
    """
    content = _complete_page(page)
    library = files("beamdae.report.page").joinpath("library", "echarts.min.js").read_text("utf-8")
    title = html.escape(make_printable(content["title"]))
    return write_text(
        path, fill_template("page", _STYLES, _SCRIPTS, content, title=title, library=library)
    )


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
        Plain values and arrays, see `encode`.
    **texts
        HTML for further placeholders, by placeholder name.
    """
    folder = files("beamdae.report.page")

    def join(kind: str, names: Sequence[str], suffix: str) -> str:
        return "\n".join((folder / kind / f"{n}{suffix}").read_text("utf-8") for n in names)

    parts = {
        "style": join("style", styles, ".css"),
        "script": join("script", scripts, ".js"),
        # Escaped so that no text in the data can close the script element.
        "data": encode(data).replace("<", "\\u003c"),
        **texts,
    }
    template = (folder / f"{name}.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def _complete_page(content: Content) -> dict[str, Any]:
    """Return the content with default entries."""
    page = {**_PAGE_DEFAULTS, **content}
    for kind, defaults in (
        ("groups", _GROUP_DEFAULTS),
        ("cases", _CASE_DEFAULTS),
        ("tables", _TABLE_DEFAULTS),
    ):
        page[kind] = [defaults | entry for entry in page[kind]]
    if "featured" not in page:
        runs = [x["curves"] for x in page["cases"] if x["curves"] and not x.get("points")]
        observed = runs[0].get("observed", {}) if runs else {}
        page["featured"] = characteristic_columns(observed)
    page["notes"] = [name_options(sentence) for sentence in page["notes"]]
    return page
