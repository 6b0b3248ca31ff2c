"""IDA of SUNDIALS through its C interface, one step at a time, in the libraries of scikit-sundae.

Residual and Jacobian are addresses of C functions.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
import weakref
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.machinery import PathFinder
from pathlib import PurePath
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from beamdae.linear.blas_threads import find_new_libraries

_SUPPORTED_MAJOR_VERSION = 7
_TEST_VECTOR_LENGTH = 3
# Marks half a buffer to which nothing has been written.
_UNCHANGED = -1
# C prototypes of SUNDIALS 7 for double precision and 32-bit indices, without MPI: result, name and
# arguments. When N_VNew_Serial is called, the index width is unknown: a 64-bit integer also passes
# a 32-bit index.
_PROTOTYPES = """
int SUNDIALSGetVersionNumber address address address address int
int SUNContext_Create int address
int SUNContext_ClearErrHandlers address
int SUNContext_Free address
int SUNLinSolFree address
address N_VNew_Serial int64 address
address N_VMake_Serial index address address
address N_VGetArrayPointer address
address SUNBandMatrix_Data address
address IDACreate address
none N_VDestroy address
none SUNMatDestroy address
none IDAFree address
address SUNBandMatrix index index index address
address SUNLinSol_Band address address address
int IDAInit address address real address address
int IDAReInit address real address address
int IDASVtolerances address real address
int IDASetLinearSolver address address address
int IDASetMaxNonlinIters address int
int IDASetMaxConvFails address int
int IDASetMaxOrd address int
int IDASetSuppressAlg address int
int IDASetMaxNumSteps address long
int IDASetInitStep address real
int IDASetMinStep address real
int IDASetMaxStep address real
int IDASetStopTime address real
int IDASolve address real address address address int
int N_VBufSize_Serial address address
int IDASetUserData address address
int IDASetJacFn address address
int IDASetId address address
int IDAGetNumErrTestFails address address
int IDAGetNumNonlinSolvConvFails address address
int IDAGetNumStepSolveFails address address
int IDAGetLastOrder address address
int IDAGetEstLocalErrors address address
"""
_TYPES: dict[str, Any] = {
    "none": None,
    "address": ctypes.c_void_p,
    "real": ctypes.c_double,
    "int": ctypes.c_int,
    "long": ctypes.c_long,
    "index": ctypes.c_int32,
    "int64": ctypes.c_int64,
}
# Calls through these prototypes release the interpreter lock.
PROTOTYPES = {
    name: ctypes.CFUNCTYPE(*(_TYPES[x] for x in (result, *arguments)))
    for result, name, *arguments in map(str.split, _PROTOTYPES.strip().splitlines())
}


class UnavailableError(Exception):
    """Raised if the C interface of SUNDIALS cannot be used; the message gives the reason."""


@dataclass(frozen=True)
class SundialsLibrary:
    """Functions of SUNDIALS.

    Attributes
    ----------
    version
        (major, minor, patch).
    addresses
        Addresses of the functions by their names in C, for compiled code.
    call
        Namespace of the functions as callables.
    """

    version: tuple[int, int, int]
    addresses: dict[str, int]
    call: Any


@cache
def load_library() -> SundialsLibrary:
    """Load the functions from the SUNDIALS libraries to which scikit-sundae is linked.

    Raises
    ------
    UnavailableError
        If scikit-sundae or a function is missing, or if the version, the precision, the index width
        or a build with MPI is not supported.
    """
    try:
        images = _find_images()
    except (ImportError, OSError) as problem:
        raise UnavailableError(f"scikit-sundae's IDA cannot be opened: {problem}") from problem
    addresses = {name: _find_address(images, name) for name in PROTOTYPES}
    if any(hasattr(image, "MPI_Comm_rank") for image in images):
        raise UnavailableError("SUNDIALS was built with MPI")
    call = SimpleNamespace(**{name: PROTOTYPES[name](at) for name, at in addresses.items()})
    version = _read_version(call)
    if version[0] != _SUPPORTED_MAJOR_VERSION:
        raise UnavailableError(
            f"SUNDIALS is {'.'.join(map(str, version))}, not {_SUPPORTED_MAJOR_VERSION}"
        )
    _check_widths(call)
    return SundialsLibrary(version, addresses, call)


def _find_images() -> list[ctypes.CDLL]:
    if sys.platform == "win32":
        from sksundae import _cy_ida  # noqa: F401

        return _open_loaded_dlls(_windows_dll_names())
    # Symbols are also looked up in the libraries that the extension module is linked to. The module
    # itself is not imported, because it imports SciPy's optimizers, which takes a third of a short
    # run.
    images = [ctypes.CDLL(_find_extension_module())]
    find_new_libraries()  # It is linked to a BLAS library.
    return images


def _find_extension_module() -> str:
    package = PathFinder.find_spec("sksundae")
    folders = package.submodule_search_locations if package else None
    module = PathFinder.find_spec("sksundae._cy_ida", folders) if folders else None
    if module is None or module.origin is None:
        raise UnavailableError("scikit-sundae has no compiled IDA")
    return module.origin


def _windows_dll_names() -> set[str]:
    """Return the names of SUNDIALS libraries on Windows, in scikit-sundae's wheel and in conda."""
    from importlib.metadata import PackageNotFoundError, files

    parts = ("core", "ida", "nvecserial", "sunmatrixband", "sunlinsolband")
    try:
        wheel = {PurePath(file).name for file in files("scikit-sundae") or ()}
    except PackageNotFoundError:
        wheel = set()
    return {f"sundials_{part}.dll" for part in parts} | {
        name for name in wheel if "sundials_" in name and name.endswith(".dll")
    }


def _open_loaded_dlls(names: Iterable[str]) -> list[ctypes.CDLL]:
    """Return the libraries with these names that the process has already loaded."""
    kernel = ctypes.CDLL("kernel32")
    kernel.GetModuleHandleW.restype = ctypes.c_void_p
    kernel.GetModuleHandleW.argtypes = (ctypes.c_wchar_p,)
    handles = {name: kernel.GetModuleHandleW(name) for name in sorted(names)}
    return [ctypes.CDLL(name, handle=handle) for name, handle in handles.items() if handle]


def _find_address(images: Iterable[ctypes.CDLL], name: str) -> int:
    for image in images:
        if hasattr(image, name):
            address = ctypes.cast(getattr(image, name), ctypes.c_void_p).value
            assert address is not None
            return address
    raise UnavailableError(f"scikit-sundae's SUNDIALS has no function {name}")


def _read_version(call: Any) -> tuple[int, int, int]:
    numbers = [ctypes.c_int() for _ in range(3)]
    label = ctypes.create_string_buffer(64)
    call.SUNDIALSGetVersionNumber(*map(ctypes.byref, numbers), label, len(label))
    major, minor, patch = (number.value for number in numbers)
    return major, minor, patch


def _check_widths(call: Any) -> None:
    """Require double precision and 32-bit indices.

    `N_VBufSize_Serial` writes the size of a vector in bytes as an index. The size shows the
    precision; an index of 32 bits leaves the second half of a buffer of 64 bits unchanged.
    """
    context = ctypes.c_void_p()
    if call.SUNContext_Create(0, ctypes.byref(context)) < 0:
        raise UnavailableError("SUNDIALS cannot create a context")
    vector = None
    try:
        vector = call.N_VNew_Serial(_TEST_VECTOR_LENGTH, context)
        buffer = (ctypes.c_int32 * 2)(_UNCHANGED, _UNCHANGED)
        if vector is None or call.N_VBufSize_Serial(vector, buffer) < 0:
            raise UnavailableError("SUNDIALS cannot create a vector")
        size, second_half = buffer
        expected = _TEST_VECTOR_LENGTH * ctypes.sizeof(ctypes.c_double)
        if (size, second_half) != (expected, _UNCHANGED):
            raise UnavailableError("SUNDIALS has numbers or indices of another width")
    finally:
        if vector is not None:
            call.N_VDestroy(vector)
        call.SUNContext_Free(ctypes.byref(context))


Array = np.ndarray

# Limits that scikit-sundae sets. The number of steps per call is also the default of IDA.
_MAX_NEWTON_ITERATIONS = 4
_MAX_CONVERGENCE_FAILURES = 10
_MIN_STEP = 0.0
_MAX_STEPS_PER_CALL = 500

# Codes above this value have different meanings in IDASolve and in linear solvers.
_FIRST_COMMON_STATUS = -20
_STATUSES = """
-1 too many steps in one call
-2 rtol and atol are too small for double precision
-3 the error test failed too often, or at the smallest step
-4 Newton's iteration failed too often, or at the smallest step
-5 the linear solver could not be initialized
-6 the setup of the linear solver failed
-7 the linear solver failed
-8 the residual cannot be evaluated
-9 the residual failed repeatedly
-12 the residual failed at the start
-14 IDA could not recover after the residual had failed
-15 Newton's iteration could not be initialized
-16 the setup of Newton's iteration failed
-17 Newton's iteration failed
-20 IDA has no memory block
-21 there is not enough memory
-22 an argument is out of range
-23 IDA was not initialized
-24 an error weight is zero
-28 a vector operation failed
-29 the context is missing
"""


class IdaError(Exception):
    """Raised if a function of SUNDIALS fails; the message names the function and the reason."""


class SolverPointers(NamedTuple):
    """Addresses for compiled code that calls IDA: its memory, and vectors for y, y' and errors."""

    memory: int
    y: int
    yp: int
    errors: int


def describe_status(status: int) -> str:
    """Return a description of a negative status of IDA."""
    descriptions = dict(line.split(" ", 1) for line in _STATUSES.strip().splitlines())
    return descriptions.get(str(status), f"error {status} of SUNDIALS")


# C memory of solvers. The memory of a deleted solver is freed when the next solver is created,
# because an interrupt during a finalizer would be printed and lost.
_live_solvers: list[tuple[weakref.ref[IdaSolver], contextlib.ExitStack]] = []


def _free_dead_solvers() -> None:
    """Free the C memory of deleted solvers, each once, from any thread."""
    for entry in [entry for entry in list(_live_solvers) if entry[0]() is None]:
        with contextlib.suppress(ValueError):
            _live_solvers.remove(entry)
            entry[1].close()


class IdaSolver:
    """IDA for r(t, y, y') = 0 with a diagonal Jacobian.

    It is set up as `IDA(linsolver="band", lband=0, uband=0)` of scikit-sundae 1.2, so that the
    steps of both agree to the last bit. Each solver has a separate context, so that several solvers
    may run simultaneously, each in one thread at a time.

    Parameters
    ----------
    residual, jacobian
        Addresses of C functions, which must outlive the solver: residual(t, y, y', r, user_data)
        and jacobian(t, c, y, y', r, J, user_data, three vectors) with J = dr/dy + c dr/dy'. IDA
        passes a Jacobian of zeros; its `SUNBandMatrix_Data` is the diagonal. A positive result
        makes IDA shorten the step, a negative result ends the run.
    user_data
        Address that IDA passes to these functions.
    rtol, atol
        Relative tolerance, and absolute tolerances, one per unknown; error weights are
        1 / (rtol |y| + atol).
    max_order, max_step
        Highest order, 1 to 5, and longest step [s].
    untested
        Mask of the unknowns that are excluded from the error test; the convergence test of Newton's
        iteration includes all unknowns. Defaults to no exclusion.

    Attributes
    ----------
    y, yp
        State, set by `start` and by each step: IDA writes into these arrays.
    errors
        Array into which compiled code lets IDA write the local errors of a step.
    pointers
        Addresses for compiled code that calls IDA directly.

    Raises
    ------
    UnavailableError
        If the C interface of SUNDIALS cannot be used.
    IdaError
        If IDA rejects an option.
    """

    def __init__(
        self,
        residual: int,
        jacobian: int,
        *,
        rtol: float,
        atol: Array,
        max_order: int,
        max_step: float,
        user_data: int | None = None,
        untested: Array | None = None,
    ) -> None:
        self._call = load_library().call
        self.y, self.yp, self.errors = (np.zeros(len(atol)) for _ in range(3))
        self.errors[:] = atol
        with contextlib.ExitStack() as stack:
            self.pointers, matrix, linear = self._create(stack)
            self._call_ida("IDASetUserData", user_data)
            self._call_ida("IDAInit", residual, 0.0, self.pointers.y, self.pointers.yp)
            # IDA copies the tolerances.
            self._call_ida("IDASVtolerances", rtol, self.pointers.errors)
            if untested is not None:
                self.errors[:] = ~untested
                self._call_ida("IDASetId", self.pointers.errors)
                self._call_ida("IDASetSuppressAlg", 1)
            self._call_ida("IDASetLinearSolver", linear, matrix)
            self._call_ida("IDASetJacFn", jacobian)
            self._call_ida("IDASetMaxNonlinIters", _MAX_NEWTON_ITERATIONS)
            self._call_ida("IDASetMaxConvFails", _MAX_CONVERGENCE_FAILURES)
            self._call_ida("IDASetMinStep", _MIN_STEP)
            self._call_ida("IDASetMaxStep", max_step)
            self._call_ida("IDASetMaxOrd", max_order)
            self._call_ida("IDASetMaxNumSteps", _MAX_STEPS_PER_CALL)
            _free_dead_solvers()
            _live_solvers.append((weakref.ref(self), stack.pop_all()))

    def _create(self, stack: contextlib.ExitStack) -> tuple[SolverPointers, int, int]:
        """Create IDA and its vectors; return their pointers, the matrix and the linear solver.

        The stack frees all of these in reverse order.
        """
        call, context, memory = self._call, ctypes.c_void_p(), ctypes.c_void_p()
        _check_status("SUNContext_Create", call.SUNContext_Create(0, ctypes.byref(context)))
        stack.callback(call.SUNContext_Free, ctypes.byref(context))
        # The default handler prints errors; the returned codes are sufficient.
        _check_status("SUNContext_ClearErrHandlers", call.SUNContext_ClearErrHandlers(context))

        def register(name: str, address: int | None, free: Any) -> int:
            if address is None:
                raise MemoryError(f"{name} of SUNDIALS: out of memory")
            stack.callback(free, address)
            return address

        size = len(self.y)
        vectors = [
            register("N_VMake_Serial", call.N_VMake_Serial(size, at, context), call.N_VDestroy)
            for at in (array.ctypes.data for array in (self.y, self.yp, self.errors))
        ]
        matrix = call.SUNBandMatrix(size, 0, 0, context)
        register("SUNBandMatrix", matrix, call.SUNMatDestroy)
        linear = call.SUNLinSol_Band(vectors[0], matrix, context)
        register("SUNLinSol_Band", linear, call.SUNLinSolFree)
        memory.value = call.IDACreate(context)
        register("IDACreate", memory.value, lambda _: call.IDAFree(ctypes.byref(memory)))
        return SolverPointers(memory.value or 0, *vectors), matrix, linear

    def start(self, t: float, y: Array, yp: Array, first_step: float) -> None:
        """Start at (y, y') at time `t` [s], with a first step of at most `first_step` [s]."""
        self.y[:], self.yp[:] = y, yp
        self._call_ida("IDASetInitStep", first_step)
        self._call_ida("IDAReInit", t, self.pointers.y, self.pointers.yp)

    def stop_at(self, end: float) -> None:
        """Forbid steps beyond the time `end` [s] until `end` is reached."""
        self._call_ida("IDASetStopTime", end)

    @property
    def failures(self) -> tuple[int, int, int]:
        """Failed error tests, steps without solution, and iterations since the last start.

        A Newton iteration that fails with an old Jacobian is repeated with a new one. If the
        repetition also fails, there is no solution, and IDA shortens the step.
        """
        names = "IDAGetNumErrTestFails", "IDAGetNumStepSolveFails", "IDAGetNumNonlinSolvConvFails"
        error_tests, solves, newton = map(self._read, names)
        return error_tests, solves, newton

    def _read(self, name: str) -> int:
        # C's long may have 32 bits; 64 bits hold both.
        value = ctypes.c_int64()
        self._call_ida(name, ctypes.byref(value))
        return value.value

    def _call_ida(self, name: str, *arguments: Any) -> None:
        """Call a function whose first argument is IDA's memory, and check its status."""
        _check_status(name, getattr(self._call, name)(self.pointers.memory, *arguments))


def _check_status(name: str, code: int) -> None:
    if code < 0:
        is_common = code <= _FIRST_COMMON_STATUS
        reason = describe_status(code) if is_common else f"error {code} of SUNDIALS"
        raise IdaError(f"{name}: {reason}")
