"""Machine code of LLVM: compiled, cached on disk, and prebuilt in wheels.

Loaded objects are executed. Therefore a file is loaded only if no other user could have written it
and its checksum is correct; on Windows, only the checksum is checked. The file name contains a hash
of the recipe from which the object was built. The file begins with the checksum of recipe and
object, and is renamed atomically to its name when it is complete. It is read only once, so that the
checked bytes are the loaded bytes.

The folder `prebuilt` contains one folder per target and in it one file per object, compressed by
zlib. Loaded objects are executed: they are trusted like the Python files of the package, because
whoever can write to the objects can also write to these files. File names contain a hash of the
text that identifies the object, so that no object is found for a changed source, which is then
compiled. A source tree has no such objects.

If compiling or loading fails, beamdae warns once and falls back to interpreted code. If caching
fails, it warns once and compiles in each process.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from beamdae.errors import warn_once
from beamdae.native import llvm
from beamdae.native.llvm import LoadedObject, MachineCodeError, Target

_UNFINISHED_PREFIX = "build-"
# SHA-256, in front of the object.
_CHECKSUM_BYTES = 32
# Leading hexadecimal digits of the checksum of a recipe in the name of its file.
_NAME_DIGITS = 32
_PRIVATE_MODE = 0o700
# Writing takes milliseconds: a file that is unfinished for longer [s] was left by a killed process.
_MAX_WRITE_SECONDS = 3600.0
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_OTHERS_ENTER = stat.S_IXGRP | stat.S_IXOTH
# Reject links, and do not wait for writers of pipes.
_OPEN_FLAGS = (
    os.O_RDONLY
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)


class CacheError(Exception):
    """Raised if the cache cannot be used; the message gives the reason."""


def cache_folder() -> Path:
    """Return the resolved path of beamdae/ in the user's cache folder, created if necessary.

    The cache folder is XDG_CACHE_HOME, or ~/.cache if XDG_CACHE_HOME is not an absolute path.

    Raises
    ------
    CacheError
        If the user has no home folder, beamdae/ cannot be created, or others could change its
        contents.
    """
    configured = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        root = configured if configured.is_absolute() else Path.home() / ".cache"
    except RuntimeError:
        raise CacheError("kernel cache: the user has no home folder; set HOME") from None
    with _translate_errors(root / "beamdae"):
        root.mkdir(mode=_PRIVATE_MODE, parents=True, exist_ok=True)
        (root / "beamdae").mkdir(mode=_PRIVATE_MODE, exist_ok=True)
        # Use the path that is checked: links in it may point elsewhere the next time.
        folder = (root / "beamdae").resolve()
        if hasattr(os, "geteuid"):
            _require_private(folder)
        return folder


def read_object(folder: Path, recipe: str, name: str) -> bytes | None:
    """Return the object built from this recipe; None if missing, damaged or not trusted."""
    with _translate_errors(folder):
        try:
            data = _read_private_file(folder / object_file_name(recipe, name)) or b""
        except OSError:
            return None
    content = data[_CHECKSUM_BYTES:]
    return content if data[:_CHECKSUM_BYTES] == _checksum(recipe, content) else None


def write_object(folder: Path, recipe: str, name: str, content: bytes) -> None:
    """Store an object atomically; an existing file is replaced, not modified in place.

    Raises
    ------
    CacheError
        If the file cannot be written.
    """
    with _translate_errors(folder):
        descriptor, unfinished = tempfile.mkstemp(prefix=_UNFINISHED_PREFIX, dir=folder)
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(_checksum(recipe, content) + content)
                file.flush()
                # Otherwise the name may reach the disk before the content.
                os.fsync(descriptor)
            _remove_abandoned_files(folder, Path(unfinished).stat().st_mtime)
            path = folder / object_file_name(recipe, name)
            if path.is_dir():
                _remove(path)
            os.replace(unfinished, path)
        finally:
            with suppress(FileNotFoundError):
                os.unlink(unfinished)


def object_file_name(recipe: str, name: str) -> str:
    """Return the name of the file of an object: its name, and a hash of its recipe."""
    return f"{name}-{hashlib.sha256(recipe.encode()).hexdigest()[:_NAME_DIGITS]}.o"


def _remove_abandoned_files(folder: Path, now: float) -> None:
    """Remove unfinished files of killed processes; `now` is the current file system time [s]."""
    for other in folder.glob(f"{_UNFINISHED_PREFIX}*"):
        with suppress(OSError):
            if now - other.stat().st_mtime > _MAX_WRITE_SECONDS:
                _remove(other)


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _checksum(recipe: str, content: bytes) -> bytes:
    digest = hashlib.sha256(recipe.encode())
    digest.update(content)
    return digest.digest()


@contextmanager
def _translate_errors(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as problem:
        raise CacheError(
            f"{folder}: machine code cannot be cached: {problem.strerror}"
        ) from problem


def _read_private_file(file: Path) -> bytes | None:
    """Return the content of a regular file that only this user can write to, else None."""
    with os.fdopen(os.open(file, _OPEN_FLAGS), "rb") as stream:
        status = os.fstat(stream.fileno())
        if not stat.S_ISREG(status.st_mode):
            return None
        if hasattr(os, "geteuid") and (
            status.st_uid != os.geteuid() or status.st_mode & _OTHERS_WRITE
        ):
            return None
        return stream.read()


def _require_private(folder: Path) -> None:
    """Require that this user owns a folder and that others can neither write to it nor move it.

    Raises
    ------
    CacheError
        If another user owns the folder, or others could change or replace it.
    """
    user = os.geteuid()
    if folder.stat().st_uid != user:
        raise _untrusted_folder_error(folder, "the folder belongs to another user")
    if stat.S_IMODE(folder.stat().st_mode) != _PRIVATE_MODE:
        # Created by an earlier version or under a permissive umask; each file is checked anyway.
        with suppress(OSError):
            folder.chmod(_PRIVATE_MODE)
    if folder.stat().st_mode & _OTHERS_WRITE:
        raise _untrusted_folder_error(folder, "others can write to the folder")
    for path in reversed(folder.parents):
        status = path.stat()
        # In containers the user id of root may differ from 0.
        if status.st_uid not in (user, os.stat("/").st_uid):
            raise _untrusted_folder_error(folder, f"{path} belongs to another user")
        # In a sticky folder, such as /tmp, users can move only what they own.
        if status.st_mode & _OTHERS_WRITE and not status.st_mode & stat.S_ISVTX:
            raise _untrusted_folder_error(folder, f"others can write to {path}")
        if status.st_uid == user and not status.st_mode & _OTHERS_ENTER:
            return  # Other users cannot enter: the folders below are protected.


def _untrusted_folder_error(folder: Path, reason: str) -> CacheError:
    return CacheError(
        f"{folder}: machine code is neither stored nor loaded because {reason}; set "
        "XDG_CACHE_HOME to a private folder"
    )


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


def is_native_enabled() -> bool:
    """Return True unless the environment variable BEAMDAE_NATIVE is "off"."""
    return os.environ.get("BEAMDAE_NATIVE", "on") != "off"


@dataclass(frozen=True)
class ObjectSource:
    """LLVM IR of an object, and the data required to cache and load it.

    Attributes
    ----------
    name
        Prefix of the file name in the cache: letters, digits and underscores.
    text
        Module of LLVM IR or, if `ir` is given, text that determines the module returned by `ir`. It
        is the same for all versions of Python and of compilers: prebuilt objects are found by it.
    symbols
        Exported symbols of the module.
    imports
        Addresses of symbols that the module imports, besides symbols of the process.
    level
        Optimization level, as in O1; 0 for IR that needs no passes.
    ir
        Function that returns the module of LLVM IR. If None, the module is `text`.
    version
        Version of a program that wrote the text, on which compiled objects in the cache depend.
    """

    name: str
    text: str
    symbols: tuple[str, ...]
    imports: Mapping[str, int] = field(default_factory=dict)
    level: int = 1
    ir: Callable[[], str] | None = None
    version: str = ""

    @property
    def identity(self) -> str:
        """Text that identifies the object among those installed with the package."""
        return f"{self.text}\nO{self.level}"

    @property
    def recipe(self) -> str:
        """Text that determines the object: source, optimization level and target."""
        return "\n".join([self.identity, self.version, *llvm.describe_target()])

    def compile(self) -> bytes:
        """Return the object for this machine."""
        return llvm.compile_module(self.module(), self.level)

    def module(self) -> str:
        """Return the module of LLVM IR."""
        return self.ir() if self.ir else self.text

    def read_prebuilt(self) -> bytes | None:
        """Return the object installed with the package for this machine; None if there is none."""
        target = llvm.host_target()
        if not has_prebuilt_objects(target):
            return None
        return read_prebuilt_object(target, self.identity, self.name)

    def load(self, content: bytes) -> LoadedObject:
        """Load `content`, the object compiled from this source, into memory."""
        return LoadedObject(content, self.symbols, self.imports)


def load_object(
    source: ObjectSource, is_correct: Callable[[LoadedObject], bool], compiles: bool = True
) -> LoadedObject | None:
    """Return machine code from the cache, the package or the compiler.

    Return None if machine code is unavailable or switched off. An object that is not from the cache
    is used and cached only if `is_correct` returns True for it; an incorrect object of the
    package is replaced by a compiled one. With `compiles` False, nothing is compiled.

    Warns
    -----
    KernelWarning
        If the cache or the compiler cannot be used, or `is_correct` returns False for a compiled
        object; once per process and reason.
    """
    if not is_native_enabled():
        return None
    try:
        folder, content = _read_cache(source)
        if content is not None:
            return source.load(content)
        content = source.read_prebuilt()
        code = None if content is None else _try_to_load(source, content)
        if content is None or code is None or not is_correct(code):
            if not compiles:
                return None
            content = source.compile()
            code = source.load(content)
            if not is_correct(code):
                raise MachineCodeError(f"LLVM: {source.name} returns wrong numbers")
    except MachineCodeError as problem:
        _warn(
            f"{problem}; runs take several times as long, with results that agree within the "
            "tolerance"
        )
        return None
    if folder is not None:
        _write_cache(folder, source, content)
    return code


def _try_to_load(source: ObjectSource, content: bytes) -> LoadedObject | None:
    """Return an object of the package, None if it imports symbols that this system lacks."""
    try:
        return source.load(content)
    except MachineCodeError:
        return None


def _read_cache(source: ObjectSource) -> tuple[Path | None, bytes | None]:
    """Return the cache folder and the object in it, each None if unavailable."""
    try:
        folder = cache_folder()
        return folder, read_object(folder, source.recipe, source.name)
    except CacheError as problem:
        _warn_of_cache(problem)
        return None, None


def _write_cache(folder: Path, source: ObjectSource, content: bytes) -> None:
    try:
        write_object(folder, source.recipe, source.name, content)
    except CacheError as problem:
        _warn_of_cache(problem)


def _warn_of_cache(problem: CacheError) -> None:
    _warn(f"{problem}; each process compiles kernels again, which takes some seconds")


def _warn(problem: str) -> None:
    warn_once(f"{problem} (BEAMDAE_NATIVE=off switches machine code off).")
