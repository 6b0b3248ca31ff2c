"""Machine code from LLVM IR: installed with the package, or compiled once and cached.

If compiling or loading fails, beamdae warns once and falls back to interpreted code. If caching
fails, it warns once and compiles in each process.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from beamdae.errors import warn_once
from beamdae.native import llvm
from beamdae.native.llvm import LoadedObject, MachineCodeError
from beamdae.native.object_cache import CacheError, cache_folder, read_object, write_object
from beamdae.native.prebuilt_objects import has_prebuilt_objects, read_prebuilt_object


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
