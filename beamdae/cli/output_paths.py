"""Check of output paths, before a command computes anything."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from beamdae.errors import BeamdaeError, short_repr
from beamdae.input_files import CHECKPOINT, require_output


def require_writable(*groups: tuple[str, Iterable[Path]]) -> None:
    """Raise an error if an output file cannot be written, or would replace another output.

    Folders are created and a scratch file is written for this purpose; both are removed again.

    Parameters
    ----------
    *groups
        Pairs of an option, named in messages, and the paths of the files that the option sets.

    Raises
    ------
    BeamdaeError
        If a path is not a valid name or is a folder, a folder cannot be created or written, or an
        output is an input, or has the path of another output or of its folder.
    """
    options: dict[Path, str] = {}
    for option, paths in groups:
        for path in paths:
            _require_file_path(option, path)
            require_output(path, option, CHECKPOINT if option == "--checkpoint" else "")
            place = Path(os.path.realpath(path.parent), path.name)
            if place in options:
                raise BeamdaeError(
                    f"{option} {path}: {options[place]} writes the same file; choose another file."
                )
            options[place] = option
    for place, option in options.items():
        if any(place in other.parents for other in options):
            raise BeamdaeError(
                f"{option} {place}: the path is the folder of other results; choose another file."
            )
    for option, paths in groups:
        for folder in dict.fromkeys(path.parent for path in paths):
            _require_folder(option, folder)


def plan_outputs(out: Path, name: str, picture: bool, page: bool = False) -> tuple[Path, Path]:
    """Return the paths of the table and the picture of an analysis in the folder of --out.

    The table must be writable, and so must be the picture and the page (a file with the suffix
    ".html" beside the table) if they are requested; see `require_writable`.
    """
    table_path, picture_path = out / f"{name}.csv", out / f"{name}.png"
    views = [*[picture_path] * picture, *[table_path.with_suffix(".html")] * page]
    require_writable(("--out", [table_path, *views]))
    return table_path, picture_path


def _require_file_path(option: str, path: Path) -> None:
    if not str(path.parent).isprintable():
        raise BeamdaeError(
            f"{option}: {short_repr(str(path.parent))} is not a valid folder name; use "
            "printable characters."
        )
    if not str(path).isprintable() or not path.name:
        raise BeamdaeError(
            f"{option}: {short_repr(str(path))} is not a valid file name; give a name "
            "of printable characters."
        )
    # Imported here because the help is printed without NumPy.
    from beamdae.results.storage.files import is_in_deleted_folder

    if is_in_deleted_folder(path):
        raise BeamdaeError(
            f"{option} {path}: the file cannot be written because the working folder has been "
            "deleted; change to an existing folder."
        )
    try:
        is_folder = path.is_dir()
        # Names that are too long are reported here.
        with suppress(FileNotFoundError, NotADirectoryError):
            path.lstat()
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise BeamdaeError(
            f"{option} {path}: the file cannot be written: {reason}; choose another name."
        ) from None
    if is_folder:
        raise BeamdaeError(
            f"{option} {path.parent}: the files cannot be written because {path} is a folder; "
            "remove this folder or choose another."
        )


def _require_folder(option: str, folder: Path) -> None:
    """Raise an error unless files can be created in the folder, which need not exist yet."""
    # Imported here because the help is printed without NumPy.
    from beamdae.results.storage.files import is_in_deleted_folder

    try:
        _create_temporarily(option, folder)
    except (OSError, BeamdaeError) as problem:
        if is_in_deleted_folder(folder):
            reason = "the working folder has been deleted"
        elif isinstance(problem, BeamdaeError):
            raise
        else:
            reason = f"of the error '{problem.strerror or problem}'"
        raise BeamdaeError(
            f"{option} {folder}: the folder cannot be written because {reason}; "
            "choose another folder."
        ) from None


def _create_temporarily(option: str, folder: Path) -> None:
    """Create the folder with a file, and remove what did not exist before."""
    created: list[Path] = []
    missing = []
    existing = folder.absolute()
    while not existing.exists():
        missing.append(existing)
        existing = existing.parent
    if not existing.is_dir():
        raise BeamdaeError(
            f"{option} {folder}: the folder cannot be written because {existing} is not a folder; "
            "choose another folder."
        )
    # The system folder of devices accepts no files, but its devices are valid outputs.
    if folder.absolute() == Path("/dev"):
        return
    scratch = folder / f".{secrets.token_hex(8)}.scratch"
    try:
        if not os.access(existing, os.W_OK | os.X_OK):
            raise PermissionError(None, f"{existing} does not allow new files")
        for each in reversed(missing):
            each.mkdir()
            created.append(each)
        try:
            scratch.write_bytes(b"\0")
        finally:
            scratch.unlink(missing_ok=True)
    finally:
        for each in reversed(created):
            with suppress(OSError):
                each.rmdir()
