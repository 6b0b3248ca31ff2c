"""Check of output paths, before a command computes anything."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from beamdae.errors import BeamdaeError, short_repr
from beamdae.input_files import CHECKPOINT, require_output


def require_writable(*groups: tuple[str, Iterable[Path]]) -> None:
    """Raise an error if an output file cannot be written, or would replace another output.

    Folders are created and a temporary file is written for this purpose; both are removed again.

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


def _require_file_path(option: str, path: Path) -> None:
    if not str(path).isprintable() or not path.name:
        raise BeamdaeError(
            f"{option}: {short_repr(str(path))} is not a valid file name; give a name "
            "of printable characters."
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

    created: list[Path] = []
    try:
        # Fails if the working folder has been deleted.
        missing = [x for x in (folder.absolute(), *folder.absolute().parents) if not x.exists()]
        for each in reversed(missing):
            each.mkdir()
            created.append(each)
        # The system folder of devices accepts no files, but its devices are valid outputs.
        if folder.absolute() != Path("/dev"):
            TemporaryFile(dir=folder).close()
    except OSError as problem:
        reason = f"of the error '{problem.strerror or problem}'"
        if is_in_deleted_folder(folder):
            reason = "the working folder has been deleted"
        raise BeamdaeError(
            f"{option} {folder}: the folder cannot be written because {reason}; "
            "choose another folder."
        ) from None
    finally:
        for each in reversed(created):
            with suppress(OSError):
                each.rmdir()
