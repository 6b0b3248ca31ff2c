"""Machine code for kernels: compiled once where there is a C compiler, cached for later runs.

The code performs the same operations in the same order as CasADi's virtual machine, without
contraction, so results are the same to the last bit, which is tried whenever one is built; the
kernels alone are about six times as fast. They depend on the element type alone, so a handful of
files serve all models. Without a compiler or a cache of the user's own, or with BEAMDAE_NATIVE=off
in the environment, the virtual machine is used.
"""

from __future__ import annotations

import os
import sys
import sysconfig
import warnings
from pathlib import Path

import casadi as ca
import numpy as np

from beamdae.errors import KernelWarning
from beamdae.symbolic.compiler import FLAGS, Compiler, CompilerError, compiler
from beamdae.symbolic.kernel_cache import CacheError, cache_folder, find, keep, scratch_folder

# Compilers that failed once in this process, and what was said of compilers and caches.
_failed: set[Compiler] = set()
_said: set[str] = set()


def native(function: ca.Function) -> ca.Function:
    """The function as machine code, or as it is where that cannot be had.

    Warns
    -----
    KernelWarning
        Once a process, of a compiler or a cache that cannot be used.
    """
    if os.environ.get("BEAMDAE_NATIVE", "on") == "off":
        return function
    try:
        found = compiler()
        return function if found is None else _from_cache(function, found)
    except (CacheError, CompilerError) as problem:
        _say(str(problem))
        return function


def _from_cache(function: ca.Function, compiler: Compiler) -> ca.Function:
    folder, name = cache_folder(), function.name()
    generator = ca.CodeGenerator(f"{name}.c")
    generator.add(function)
    source = generator.dump()
    # Home folders are shared by machines of several kinds.
    machine = (sys.platform, sysconfig.get_platform(), sysconfig.get_config_var("SOABI") or "")
    recipe = "\n".join([source, *compiler.command, *FLAGS, *machine])
    library = find(folder, recipe, name)
    if library is not None:
        return _loaded(function, library, f"{library}: it cannot be loaded")
    if compiler in _failed:
        return function
    try:
        with scratch_folder(folder) as scratch:
            built = _built(function, compiler, source, scratch / "kernel.so")
            keep(folder, recipe, name, scratch / "kernel.so")
            return built
    except CompilerError:
        _failed.add(compiler)
        raise


def _built(function: ca.Function, compiler: Compiler, source: str, library: Path) -> ca.Function:
    code = library.with_suffix(".c")
    code.write_text(source, encoding="utf-8")
    compiler.build(code, library)
    built = _loaded(function, library, f"{compiler}: what it builds cannot be loaded")
    if not _same(function, built):
        raise CompilerError(f"{compiler}: its kernels do not give the same numbers to the last bit")
    return built


def _loaded(function: ca.Function, library: Path, otherwise: str) -> ca.Function:
    try:
        return ca.external(function.name(), str(library))
    except RuntimeError as problem:
        raise CompilerError(otherwise) from problem


def _same(function: ca.Function, other: ca.Function) -> bool:
    """Whether two functions give the same bits at some points."""
    random = np.random.default_rng(0)
    for _ in range(3):
        shapes = [function.sparsity_in(i) for i in range(function.n_in())]
        point = [ca.DM(shape, random.uniform(0.5, 1.5, shape.nnz())) for shape in shapes]
        for expected, found in zip(function.call(point), other.call(point), strict=True):
            if not np.array_equal(expected.nonzeros(), found.nonzeros(), equal_nan=True):
                return False
    return True


def _say(problem: str) -> None:
    if problem not in _said:
        _said.add(problem)
        warnings.warn(
            f"{problem}; runs take about 1.5 times as long, with the same numbers "
            "(BEAMDAE_NATIVE=off does without compiled kernels).",
            KernelWarning,
            stacklevel=3,
        )
