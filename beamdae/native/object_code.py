"""Machine code of LLVM IR: built once, kept for later runs, done without where that cannot be."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from beamdae.errors import KernelWarning
from beamdae.native import llvm as machine
from beamdae.native.llvm import LoadedObject, MachineCodeError
from beamdae.native.object_cache import CacheError, cache_folder, read_object, write_object

# What was said in this process.
_issued_messages: set[str] = set()


def is_native_enabled() -> bool:
    """Whether machine code is wanted: BEAMDAE_NATIVE=off does without."""
    return os.environ.get("BEAMDAE_NATIVE", "on") != "off"


@dataclass(frozen=True)
class ObjectSource:
    """What machine code is made of.

    Attributes
    ----------
    name
        With which its files in the cache begin: letters, digits and underscores.
    text
        A module of LLVM IR, or whatever `ir` makes it of.
    symbols
        Of the module, whose addresses are wanted.
    imports
        Addresses of symbols the module takes from outside, besides those of the process itself.
    level
        Of optimization, as in O1: 0 for IR that needs none.
    ir
        Makes the module of LLVM IR; None: it is the text.
    """

    name: str
    text: str
    symbols: tuple[str, ...]
    imports: Mapping[str, int] = field(default_factory=dict)
    level: int = 1
    ir: Callable[[], str] | None = None

    @property
    def recipe(self) -> str:
        """Whatever the object depends on."""
        return "\n".join([self.text, f"O{self.level}", *machine.describe_target()])

    def load(self, content: bytes) -> LoadedObject:
        """Its object, in memory."""
        return LoadedObject(content, self.symbols, self.imports)


def load_object(
    source: ObjectSource, is_right: Callable[[LoadedObject], bool]
) -> LoadedObject | None:
    """Machine code of LLVM IR, or None where it cannot be had or is not wanted.

    What was built is kept for later runs if `is_right` says so.

    Warns
    -----
    KernelWarning
        Once a process, of a cache or a machine that cannot be used.
    """
    if not is_native_enabled():
        return None
    try:
        folder, content = _read_cache(source)
        if content is not None:
            return source.load(content)
        content = machine.compile_module(source.ir() if source.ir else source.text, source.level)
        code = source.load(content)
        if not is_right(code):
            raise MachineCodeError(f"LLVM: {source.name} does not give the right numbers")
    except MachineCodeError as problem:
        _warn_once(f"{problem}; runs take several times as long, with the same numbers to rounding")
        return None
    if folder is not None:
        _write_cache(folder, source, content)
    return code


def _read_cache(source: ObjectSource) -> tuple[Path | None, bytes | None]:
    """The cache, if it can be used, and what it has."""
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
    _warn_once(f"{problem}; each run compiles its loops, which takes some seconds")


def _warn_once(problem: str) -> None:
    if problem not in _issued_messages:
        _issued_messages.add(problem)
        warnings.warn(
            f"{problem} (BEAMDAE_NATIVE=off does without machine code).",
            KernelWarning,
            stacklevel=3,
        )
