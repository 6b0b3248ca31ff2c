"""Machine code for kernels: compiled once where there is a C compiler, cached for later runs.

The code performs the same operations in the same order as CasADi's virtual machine, without
contraction, so results are the same to the last bit; the kernels alone are about six times as
fast. They depend on the element type alone, so a handful of files serve all models. Without a
compiler or a cache of the user's own, or with BEAMDAE_NATIVE=off in the environment, the virtual
machine is used.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import warnings
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np

from beamdae.errors import KernelWarning
from beamdae.symbolic.compiler import FLAGS, Compiler, CompilerError, compiler
from beamdae.symbolic.kernel_cache import (
    CacheError,
    cache_folder,
    discard,
    keep,
    kept,
    require_private,
)

# What a kernel may differ from the virtual machine by, over its largest value, at points of unit
# size: some thousand operations, each of which rounds.
_ROUNDING = 1e-10
_POINTS = 3

# What went wrong once in this process is told once, and not waited for again.
_given_up: set[str] = set()


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
        return function if found is None else _compiled(function, found, cache_folder())
    except (CacheError, CompilerError) as problem:
        _give_up(str(problem))
        return function


def _compiled(function: ca.Function, compiler: Compiler, folder: Path) -> ca.Function:
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    source = generator.dump()
    recipe = "\n".join([source, *compiler.command, *FLAGS, sys.platform, platform.machine()])
    name = f"{function.name()}-{hashlib.sha256(recipe.encode()).hexdigest()[:24]}"
    require_private(folder)
    library = kept(folder, name)
    if library is not None:
        return ca.external(function.name(), str(library))
    if str(compiler) in _given_up:
        return function
    try:
        return _loaded(function, keep(folder, name, partial(compiler.build, source)), compiler)
    except CompilerError:
        _given_up.add(str(compiler))
        raise


def _loaded(function: ca.Function, library: Path, compiler: Compiler) -> ca.Function:
    """The function of a library just built, which has to give what the virtual machine does."""
    try:
        built = ca.external(function.name(), str(library))
        if _alike(function, built):
            return built
        what = "kernels that compute something else"
    except RuntimeError:
        what = "libraries that cannot be loaded"
    discard(library)
    raise CompilerError(f"{compiler}: it gives {what}")


def _give_up(reason: str) -> None:
    if reason not in _given_up:
        _given_up.add(reason)
        warnings.warn(
            f"{reason}; kernels run without machine code, several times as slow with the same "
            "results.",
            KernelWarning,
            stacklevel=2,
        )


def _alike(function: ca.Function, other: ca.Function) -> bool:
    """Whether two functions give the same values at some points."""
    random = np.random.default_rng(0)
    for _ in range(_POINTS):
        point = [
            ca.DM(function.sparsity_in(i), random.uniform(0.5, 1.5, function.nnz_in(i)))
            for i in range(function.n_in())
        ]
        for value, told in zip(function.call(point), other.call(point), strict=True):
            expected, found = np.array(value.nonzeros()), np.array(told.nonzeros())
            size = np.max(np.abs(expected), initial=0.0)
            if not np.allclose(found, expected, rtol=0.0, atol=_ROUNDING * size, equal_nan=True):
                return False
    return True
