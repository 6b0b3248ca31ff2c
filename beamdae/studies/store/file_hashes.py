"""Files results depend on: which are the user's own, and hashes of what they hold."""

from __future__ import annotations

import hashlib
import os
import site
import sysconfig
from functools import cache
from pathlib import Path

PACKAGE_FOLDER = Path(__file__).parents[2]
# Commands and reports are no part of a result.
_PACKAGES_WITHOUT_EFFECT = ("cli", "report")
# What the system holds, and what programs keep for themselves.
_SYSTEM_FOLDERS = ("/proc", "/sys", "/dev", "/etc", "/usr/share")


@cache
def _installed_folders() -> tuple[str, ...]:
    folders = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    folders += [
        *site.getsitepackages(),
        site.getusersitepackages(),
        *_SYSTEM_FOLDERS,
        str(PACKAGE_FOLDER),
    ]
    folders.append(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    both = {x for folder in folders if folder for x in (folder, os.path.realpath(folder))}
    return tuple(f"{folder.rstrip(os.sep)}{os.sep}" for folder in both)


@cache
def is_installed(file: str) -> bool:
    """Whether a file is no user's own: a part of Python, of a package or of the system."""
    return file.startswith("<frozen ") or file.startswith(_installed_folders())


@cache
def digest_package() -> str:
    """Hash of beamdae's own sources, as they are when it is asked first."""
    whole = hashlib.sha256()
    for path in sorted(PACKAGE_FOLDER.rglob("*.py")):
        place = path.relative_to(PACKAGE_FOLDER)
        if place.parts[0] not in _PACKAGES_WITHOUT_EFFECT:
            whole.update(f"{place.as_posix()}\0".encode())
            whole.update(path.read_bytes() + b"\0")
    return whole.hexdigest()


def file_signature(path: str) -> tuple[int, int, int] | None:
    """What changes when a file does; None if there is no such file."""
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino


def digest_file(path: str) -> str | None:
    """Hash of what a file holds; None if there is no such file, or it cannot be read."""
    return _digest_signed_file(path, file_signature(path))


@cache
def _digest_signed_file(path: str, changed: tuple[int, int, int] | None) -> str | None:
    if changed is None:
        return None
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
