"""Machine code from LLVM IR, compiled once and cached.

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
        Module of LLVM IR or, if `ir` is given, text that determines the module returned by `ir`.
    symbols
        Exported symbols of the module.
    imports
        Addresses of symbols that the module imports, besides symbols of the process.
    level
        Optimization level, as in O1; 0 for IR that needs no passes.
    ir
        Function that returns the module of LLVM IR. If None, the module is `text`.
    """

    name: str
    text: str
    symbols: tuple[str, ...]
    imports: Mapping[str, int] = field(default_factory=dict)
    level: int = 1
    ir: Callable[[], str] | None = None

    @property
    def recipe(self) -> str:
        """Text that determines the object: source, optimization level and target."""
        return "\n".join([self.text, f"O{self.level}", *llvm.describe_target()])

    def load(self, content: bytes) -> LoadedObject:
        """Load `content`, the object compiled from this source, into memory."""
        return LoadedObject(content, self.symbols, self.imports)


def load_object(
    source: ObjectSource, is_correct: Callable[[LoadedObject], bool], compiles: bool = True
) -> LoadedObject | None:
    """Return machine code from the cache or the compiler; None if unavailable or switched off.

    A newly compiled object is used and cached only if `is_correct` returns True for it. With
    `compiles` False, only the cache is used.

    Warns
    -----
    KernelWarning
        If the cache or the compiler cannot be used, or `is_correct` returns False; once per process
        and reason.
    """
    if not is_native_enabled():
        return None
    try:
        folder, content = _read_cache(source)
        if content is not None:
            return source.load(content)
        if not compiles:
            return None
        content = llvm.compile_module(source.ir() if source.ir else source.text, source.level)
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
    _warn(f"{problem}; each process compiles kernels and loops again, which takes some seconds")


def _warn(problem: str) -> None:
    warn_once(f"{problem} (BEAMDAE_NATIVE=off switches machine code off).")
