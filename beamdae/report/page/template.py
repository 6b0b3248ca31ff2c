"""Templates of pages, filled with their styles, scripts and data."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any


def filled(
    name: str, styles: Sequence[str], scripts: Sequence[str], data: Mapping[str, Any], **texts: str
) -> str:
    """A template of this folder with everything it refers to in it."""
    folder = files("beamdae.report.page")
    written = json.dumps(data, allow_nan=False, separators=(",", ":"))
    parts = {
        "style": _joined(folder / "style", styles, ".css"),
        "script": _joined(folder / "script", scripts, ".js"),
        # No tag can begin within the data.
        "data": written.replace("<", "\\u003c"),
        **texts,
    }
    template = folder.joinpath(f"{name}.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def _joined(folder: Traversable, names: Sequence[str], suffix: str) -> str:
    return "\n".join((folder / f"{n}{suffix}").read_text(encoding="utf-8") for n in names)
