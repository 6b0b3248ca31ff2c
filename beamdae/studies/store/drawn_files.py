"""Pictures that are drawn again only if something that they show has changed."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from beamdae.package_versions import installed_version
from beamdae.results.storage.files import write_text
from beamdae.studies.store.file_hashes import digest_file, digest_package, file_signature


def draw_unless_unchanged(
    folder: Path, name: str, content: Any, draw: Callable[[], list[Path]]
) -> list[Path]:
    """Return the paths of the pictures that `draw` writes to `folder`.

    `draw` is not called if the pictures exist as it wrote them, and it would write them from the
    same content with the same versions and settings.

    Parameters
    ----------
    folder
        Results folder; `folder`/outcomes contains the hashes of the content and of the pictures.
    name
        Name of the pictures.
    content
        Everything that the pictures show; its `repr` determines them.
    draw
        Function that writes the pictures and returns their paths.
    """
    text = repr((content, _describe_drawing()))
    digest = hashlib.sha256(text.encode(errors="backslashreplace")).hexdigest()
    record = folder / "outcomes" / f"{name}.drawn"
    try:
        stored = json.loads(record.read_text())
        files = {folder / Path(file).name: x for file, x in stored["files"].items()}
        if stored["content"] == digest and all(digest_file(str(p)) == x for p, x in files.items()):
            return list(files)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        pass  # The record does not exist or is damaged.
    paths = draw()
    hashes = {path.name: digest_file(str(path)) for path in paths}
    write_text(record, json.dumps({"content": digest, "files": hashes}))
    return paths


def _describe_drawing() -> Any:
    """Return versions and settings on which pictures depend, besides their content."""
    home = os.environ.get("XDG_CONFIG_HOME") or os.path.expanduser("~/.config")
    # Each may be a file or a folder with a file of this name.
    places = (os.environ.get("MATPLOTLIBRC", ""), os.curdir, os.path.join(home, "matplotlib"))
    names = [name for x in places for name in (x, os.path.join(x, "matplotlibrc"))]
    settings = [file_signature(name) if os.path.isfile(name) else None for name in names]
    return installed_version("matplotlib"), digest_package("report"), settings
