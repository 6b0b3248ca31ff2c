"""Kernels as machine code: SX functions evaluated for many copies, one per vector lane.

The code performs the operations of CasADi's virtual machine in the same order and without
contraction, so that results agree to the last bit. This is tested whenever a kernel is compiled.
"""

from __future__ import annotations

import ctypes
import inspect
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial, reduce
from typing import Any

import casadi as ca
import numpy as np

from beamdae.deferred import installed_version
from beamdae.native.lane_code import (
    LANE_WIDTH,
    describe_writer,
    library_imports,
    require_lane_form,
    write_lane_module,
)
from beamdae.native.llvm import LoadedObject
from beamdae.native.object_code import ObjectSource, is_native_enabled, load_object

Array = np.ndarray
# Returns a faster function of the same values.
Rewrite = Callable[[ca.Function], ca.Function]

# Straight-line code gains nothing from LLVM's passes, which take a third of the build time.
_OPTIMIZATION_LEVEL = 0
_OPTIMIZATION_LEVEL_OF_LOOPS = 2
# Loops add numbers in another order than straight-line code.
_ROUNDING = 1e-10
# Rows whose length [doubles] is a multiple of this map to few sets of the processor cache, so that
# tangents take up to 1.7 times as long.
_CACHE_CONFLICT_STRIDE = 128
KERNEL_SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64)
# Number of points at which a new kernel is compared with the virtual machine: three vectors.
_N_TEST_COPIES = 3 * LANE_WIDTH


def pad_copies(copies: int) -> int:
    """Return the number of lanes for these copies: whole vectors, without cache conflicts."""
    length = -(-copies // LANE_WIDTH) * LANE_WIDTH
    return length + LANE_WIDTH if length and length % _CACHE_CONFLICT_STRIDE == 0 else length


@dataclass(frozen=True)
class LaneKernel:
    """A function of (shared, local) as machine code that evaluates vectors of copies.

    Its C prototype is void f(const double *shared, const double *local, double *out,
    int64_t padded), where `local` is [n_local][padded] and `out` is [n_out][padded]. The address is
    valid as long as the `LaneKernel` exists.

    Attributes
    ----------
    name
        Name of the function.
    address
        Address of the machine code.
    n_shared, n_local, n_out
        Numbers of inputs shared by all copies, of inputs per copy, and of outputs per copy.
    code
        Loaded object that contains the machine code and keeps it in memory.
    called
        Kernels that the machine code calls.
    """

    name: str
    address: int
    n_shared: int
    n_local: int
    n_out: int
    code: LoadedObject = field(repr=False, compare=False)
    called: tuple[LaneKernel, ...] = field(default=(), repr=False, compare=False)

    @cached_property
    def _call(self) -> Any:
        return KERNEL_SIGNATURE(self.address)

    def __call__(self, shared: Array, local: Array, out: Array | None = None) -> Array:
        """Return values (n_out, padded) for `shared` (n_shared,) and `local` (n_local, padded).

        They are written into `out`, a C-contiguous array of float64, if it is given. Shapes are not
        checked.
        """
        shared, local = (np.ascontiguousarray(x, np.float64) for x in (shared, local))
        count = local.shape[-1]
        out = np.empty((self.n_out, count)) if out is None else out
        self.bind(shared, local, out)(count)
        return out

    def bind(self, shared: Array, local: Array, out: Array) -> Callable[[int], None]:
        """Return a function that evaluates as many copies as its argument, in these buffers.

        The buffers are C-contiguous arrays of float64, which are large enough and exist as long as
        the function; they are not checked. The argument is a multiple of `LANE_WIDTH`.
        """
        return partial(self._call, *(x.ctypes.data for x in (shared, local, out)))


def rewrite(function: ca.Function, steps: Sequence[Rewrite]) -> ca.Function:
    """Return the function after all steps."""
    return reduce(lambda rewritten, step: step(rewritten), steps, function)


def build_lane_kernel(
    function: ca.Function, compiles: bool = True, rewrites: Sequence[Rewrite] = ()
) -> LaneKernel | None:
    """Compile an SX function of two columns, (shared, local), with one dense column as output.

    The code is that of the function after all `rewrites`, which are called only if it is not in the
    cache. The source of their modules is part of the cache key.

    Return None if the function has an operation that cannot be compiled, if machine code is
    unavailable or switched off, or if `compiles` is False and the machine code is not in the cache.

    Raises
    ------
    ValueError
        If the function has another form.

    Warns
    -----
    KernelWarning
        If the cache or the compiler cannot be used; once per process and reason.
    """
    if not is_native_enabled():
        return None
    require_lane_form(function)
    name = function.name()

    # The function, the rewrites and the writer determine the IR; writing the IR to build a cache
    # key is slower.
    text = "\n".join([function.serialize(), *map(_describe_rewrite, rewrites), describe_writer()])
    source = ObjectSource(
        name=name,
        text=text,
        symbols=(name,),
        imports=library_imports(),
        level=_OPTIMIZATION_LEVEL,
        ir=lambda: write_lane_module(rewrite(function, rewrites)),
        # Prebuilt objects are checked against the installed CasADi before use.
        version=f"casadi {installed_version('casadi')}",
    )

    def is_correct(kernel: LaneKernel) -> bool:
        values = _evaluate_both(rewrite(function, rewrites), kernel)
        return np.array_equal(*values, equal_nan=True)

    try:
        return _load_kernel(source, function, is_correct, compiles)
    except ValueError:
        return None


def build_loop_kernel(
    function: ca.Function,
    text: str,
    called: Mapping[str, LaneKernel],
    compiles: bool = True,
) -> LaneKernel | None:
    """Compile a module of LLVM IR that evaluates `function` and calls other kernels by name.

    For the results and warnings, see `build_lane_kernel`.
    """
    name = function.name()

    def is_correct(kernel: LaneKernel) -> bool:
        values, expected = _evaluate_both(function, kernel)
        scale = np.abs(expected).max(initial=0.0)
        return bool(np.all(np.abs(values - expected) <= _ROUNDING * scale))

    source = ObjectSource(
        name=name,
        text=text,
        symbols=(name,),
        imports={symbol: kernel.address for symbol, kernel in called.items()},
        level=_OPTIMIZATION_LEVEL_OF_LOOPS,
    )
    return _load_kernel(source, function, is_correct, compiles, tuple(called.values()))


def _load_kernel(
    source: ObjectSource,
    function: ca.Function,
    is_correct: Callable[[LaneKernel], bool],
    compiles: bool,
    called: tuple[LaneKernel, ...] = (),
) -> LaneKernel | None:
    sizes = function.nnz_in(0), function.nnz_in(1), function.nnz_out(0)

    def wrap_code(code: LoadedObject) -> LaneKernel:
        return LaneKernel(source.name, code.addresses[source.name], *sizes, code, called)

    code = load_object(source, lambda code: is_correct(wrap_code(code)), compiles)
    return None if code is None else wrap_code(code)


@cache
def _describe_rewrite(step: Rewrite) -> str:
    return f"{step.__qualname__}\n{inspect.getsource(sys.modules[step.__module__])}"


def _evaluate_both(function: ca.Function, kernel: LaneKernel) -> tuple[Array, Array]:
    """Return the values of a kernel and of CasADi's virtual machine at random points."""
    random = np.random.default_rng(0)
    shared = random.uniform(0.5, 1.5, kernel.n_shared)
    local = random.uniform(0.5, 1.5, (kernel.n_local, _N_TEST_COPIES))
    # Equal copies at the end, as in padding lanes.
    local[:, -LANE_WIDTH // 2 :] = local[:, -1:]
    values = kernel(shared, local)
    expected = np.hstack([function(shared, column).full() for column in local.T])
    return values, expected
