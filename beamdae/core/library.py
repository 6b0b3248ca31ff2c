"""The core as a shared library: installed with the package, or compiled once and cached."""

from __future__ import annotations

import ctypes
import os
import platform
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

from beamdae.core.compilers import CORE_FLAGS, compile_library, find_compiler
from beamdae.errors import BeamdaeError, warn_once
from beamdae.native import llvm
from beamdae.native.object_code import (
    CacheError,
    cache_folder,
    has_prebuilt_objects,
    read_object,
    read_prebuilt_object,
    write_object,
)

FOLDER = Path(__file__).parent
NAME = "core"
# Results have the same bits on all processors: multiplications and additions are not fused.
_FLAGS = ("-O3", "-funroll-loops")


def core_sources() -> list[Path]:
    """Return the C files of the core."""
    return sorted(FOLDER.glob("*.c"))


def core_identity() -> str:
    """Return the text that determines what the core computes: its sources, and flags."""
    files = sorted([*FOLDER.glob("*.h"), *core_sources()])
    return "\n".join([*(file.read_text("utf-8") for file in files), *CORE_FLAGS, *_FLAGS])


def _processor_flags(target: llvm.Target | None, compiler: list[str]) -> list[str]:
    """Return the flags for a level of x86-64; other processors have no such levels."""
    if target is None or target.cpu not in llvm.X86_LEVELS:
        return []
    # ziglang has its own names of processors.
    return [f"-march={target.cpu.replace('-', '_') if 'ziglang' in compiler else target.cpu}"]


def compile_core(target: llvm.Target | None) -> bytes:
    """Compile the core for a processor of this system.

    Raises
    ------
    BeamdaeError
        If there is no compiler, or it fails.
    """
    compiler = find_compiler("core")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "core.so")
        processor = _processor_flags(target, compiler)
        try:
            compile_library("core", compiler, [*_FLAGS, *processor], core_sources(), file)
        except BeamdaeError:
            if not processor:
                raise
            # Older compilers know no levels of processors.
            compile_library("core", compiler, _FLAGS, core_sources(), file)
        return file.read_bytes()


@cache
def load_core() -> ctypes.CDLL | None:
    """Return the core; None if it is neither installed nor can be compiled.

    Warns
    -----
    KernelWarning
        If there is no core.
    """
    try:
        return _load_library(_read_library())
    except (BeamdaeError, OSError) as problem:
        warn_once(
            f"{str(problem).rstrip('.')}. Without the compiled core, only GeneralizedAlpha with "
            "fixed steps and Ida are available, and runs take several times as long"
        )
        return None


def function_address(name: str) -> int:
    """Return the address of a function of the core, which must exist."""
    return int(ctypes.cast(getattr(load_core(), name), ctypes.c_void_p).value or 0)


def _read_library() -> bytes:
    """Return the shared library from the cache, the package or the compiler."""
    try:
        target = llvm.host_target()
    except llvm.MachineCodeError:
        target = None
    identity = core_identity()
    recipe = "\n".join([identity, sys.platform, platform.machine(), *(target or ())])
    folder = None
    with suppress(CacheError):
        folder = cache_folder()
        content = read_object(folder, recipe, NAME)
        if content is not None:
            return content
    if target is not None and has_prebuilt_objects(target):
        content = read_prebuilt_object(target, identity, NAME)
        if content is not None:
            return content
    content = compile_core(target)
    if folder is not None:
        with suppress(CacheError):
            write_object(folder, recipe, NAME, content)
    return content


def _load_library(content: bytes) -> ctypes.CDLL:
    """Load a shared library from memory: a file could be replaced after its checksum is tested."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("beamdae-core")
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            stream.flush()
            return ctypes.CDLL(f"/proc/self/fd/{descriptor}")
    with tempfile.NamedTemporaryFile(suffix=".so", delete=False) as file:
        file.write(content)
    try:
        return ctypes.CDLL(file.name)
    finally:
        with suppress(OSError):
            os.unlink(file.name)
