"""Machine code installed with the package, compiled and checked when the wheel was built.

The folder `prebuilt` contains one folder per target and in it one file per object, compressed by
zlib. Loaded objects are executed: they are trusted like the Python files of the package, because
whoever can write to the objects can also write to these files. File names contain a hash of the
text that identifies the object, so that no object is found for a changed source, which is then
compiled. A source tree has no such objects.
"""

from __future__ import annotations

import zlib
from functools import cache
from pathlib import Path

from beamdae.native.llvm import Target
from beamdae.native.object_cache import object_file_name

FOLDER = Path(__file__).with_name("prebuilt")
_COMPRESSION_LEVEL = 9


def target_folder(target: Target) -> Path:
    """Return the folder of the objects for a target, relative to `FOLDER`."""
    architecture, *rest = target.triple.split("-")
    # Objects depend on the system, but not on its C library.
    system = "linux" if "linux" in rest else "-".join(rest)
    return Path(f"{architecture}-{system}", target.cpu)


def has_prebuilt_objects(target: Target) -> bool:
    """Return True if the package contains objects for a target."""
    return bool(_file_names(FOLDER / target_folder(target)))


def read_prebuilt_object(target: Target, identity: str, name: str) -> bytes | None:
    """Return the object with this identity and name for a target; None if there is none."""
    folder, file_name = FOLDER / target_folder(target), object_file_name(identity, name)
    if file_name not in _file_names(folder):
        return None
    try:
        return zlib.decompress((folder / file_name).read_bytes())
    except (OSError, zlib.error):
        return None


def write_prebuilt_object(folder: Path, identity: str, name: str, content: bytes) -> None:
    """Write an object into the folder of a target."""
    compressed = zlib.compress(content, _COMPRESSION_LEVEL)
    (folder / object_file_name(identity, name)).write_bytes(compressed)


@cache
def _file_names(folder: Path) -> frozenset[str]:
    try:
        return frozenset(file.name for file in folder.iterdir())
    except OSError:
        return frozenset()
