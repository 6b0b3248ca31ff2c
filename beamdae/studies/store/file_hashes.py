"""Hashes of the user files and beamdae source files that results depend on."""

from __future__ import annotations

import hashlib
import os
import site
import sysconfig
from functools import cache
from pathlib import Path

from beamdae.results.storage.reader import open_regular_file

PACKAGE_FOLDER = Path(__file__).parents[2]
_PACKAGES_WITHOUT_EFFECT = frozenset({"cli", "report"})  # results do not depend on them
_SYSTEM_FOLDERS = ("/proc", "/sys", "/dev", "/etc", "/usr/share")

# Modification time [ns], size [bytes] and inode; None if the file is missing or inaccessible.
FileSignature = tuple[int, int, int] | None


@cache
def _installed_folders() -> tuple[str, ...]:
    folders = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    folders += [*site.getsitepackages(), site.getusersitepackages()]
    folders += [*_SYSTEM_FOLDERS, str(PACKAGE_FOLDER)]
    folders.append(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    with_targets = {x for folder in folders if folder for x in (folder, os.path.realpath(folder))}
    return tuple(f"{folder.rstrip(os.sep)}{os.sep}" for folder in with_targets)


@cache
def is_installed(file: str) -> bool:
    """Return True if a file belongs to Python, an installed package, the system or a cache."""
    return file.startswith("<frozen ") or file.startswith(_installed_folders())


@cache
def digest_package(*also: str) -> str:
    """Return the hash of the source code of beamdae, cached.

    The packages `cli` and `report` are included only if `also` contains their names.
    """
    digest, excluded = hashlib.sha256(), _PACKAGES_WITHOUT_EFFECT - {*also}
    for path in sorted(PACKAGE_FOLDER.rglob("*.py")):
        relative = path.relative_to(PACKAGE_FOLDER)
        if relative.parts[0] not in excluded:
            digest.update(f"{relative.as_posix()}\0".encode())
            digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()


def file_signature(path: str) -> FileSignature:
    """Return the signature of a file; None if it is missing or inaccessible."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def digest_file(path: str) -> str | None:
    """Return the hash of the content of a file; None if it is missing or unreadable."""
    return _digest_signed_file(path, file_signature(path))


@cache
def _digest_signed_file(path: str, signature: FileSignature) -> str | None:
    if signature is None:
        return None
    try:
        # Reading a pipe or a device, which a record may name, would not end.
        with open_regular_file(path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
