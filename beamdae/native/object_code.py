"""Machine code of LLVM IR: built once, kept for later runs, done without where that cannot be."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from beamdae.errors import KernelWarning
from beamdae.native import llvm as machine
from beamdae.native.cache import CacheError, cache_folder, find, keep
from beamdae.native.llvm import Loaded, MachineError

# What was said in this process.
_said: set[str] = set()


def is_on() -> bool:
    """Whether machine code is wanted: BEAMDAE_NATIVE=off does without."""
    return os.environ.get("BEAMDAE_NATIVE", "on") != "off"


@dataclass(frozen=True)
class Source:
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
        return "\n".join([self.text, f"O{self.level}", *machine.recipe()])

    def load(self, content: bytes) -> Loaded:
        """Its object, in memory."""
        return Loaded(content, self.symbols, self.imports)


def machine_code(source: Source, is_right: Callable[[Loaded], bool]) -> Loaded | None:
    """Machine code of LLVM IR, or None where it cannot be had or is not wanted.

    What was built is kept for later runs if `is_right` says so.

    Warns
    -----
    KernelWarning
        Once a process, of a cache or a machine that cannot be used.
    """
    if not is_on():
        return None
    try:
        folder, content = _found(source)
        if content is not None:
            return source.load(content)
        content = machine.compiled(source.ir() if source.ir else source.text, source.level)
        code = source.load(content)
        if not is_right(code):
            raise MachineError(f"LLVM: {source.name} does not give the right numbers")
    except MachineError as problem:
        _say(f"{problem}; runs take several times as long, with the same numbers to rounding")
        return None
    if folder is not None:
        _keep(folder, source, content)
    return code


def _found(source: Source) -> tuple[Path | None, bytes | None]:
    """The cache, if it can be used, and what it has."""
    try:
        folder = cache_folder()
        return folder, find(folder, source.recipe, source.name)
    except CacheError as problem:
        _say_of_cache(problem)
        return None, None


def _keep(folder: Path, source: Source, content: bytes) -> None:
    try:
        keep(folder, source.recipe, source.name, content)
    except CacheError as problem:
        _say_of_cache(problem)


def _say_of_cache(problem: CacheError) -> None:
    _say(f"{problem}; each run compiles its loops, which takes some seconds")


def _say(problem: str) -> None:
    if problem not in _said:
        _said.add(problem)
        warnings.warn(
            f"{problem} (BEAMDAE_NATIVE=off does without machine code).",
            KernelWarning,
            stacklevel=3,
        )
