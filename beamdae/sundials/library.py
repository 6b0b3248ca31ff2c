"""Access to the SUNDIALS libraries of scikit-sundae, without loading a second copy."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.machinery import PathFinder
from pathlib import PurePath
from types import SimpleNamespace
from typing import Any

from beamdae.linear.blas_threads import find_new_libraries

_SUPPORTED_MAJOR_VERSION = 7
_TEST_VECTOR_LENGTH = 3
# Marks half a buffer to which nothing has been written.
_UNCHANGED = -1
# C prototypes of SUNDIALS 7 for double precision and 32-bit indices, without MPI.
_address, _real, _index = ctypes.c_void_p, ctypes.c_double, ctypes.c_int32
_code, _int, _long = ctypes.c_int, ctypes.c_int, ctypes.c_long


# (result, *arguments) -> functions.
_SIGNATURES: dict[tuple[Any, ...], tuple[str, ...]] = {
    (_code, *[_address] * 4, _int): ("SUNDIALSGetVersionNumber",),
    (_code, _int, _address): ("SUNContext_Create",),
    (_code, _address): ("SUNContext_ClearErrHandlers", "SUNContext_Free", "SUNLinSolFree"),
    # Called before the index width is known: a 64-bit integer also passes a 32-bit index.
    (_address, ctypes.c_int64, _address): ("N_VNew_Serial",),
    (_address, _index, _address, _address): ("N_VMake_Serial",),
    (_address, _address): ("N_VGetArrayPointer", "SUNBandMatrix_Data", "IDACreate"),
    (None, _address): ("N_VDestroy", "SUNMatDestroy", "IDAFree"),
    (_address, *[_index] * 3, _address): ("SUNBandMatrix",),
    (_address, *[_address] * 3): ("SUNLinSol_Band",),
    (_code, _address, _address, _real, _address, _address): ("IDAInit",),
    (_code, _address, _real, _address, _address): ("IDAReInit",),
    (_code, _address, _real, _address): ("IDASVtolerances",),
    (_code, _address, _address, _address): ("IDASetLinearSolver",),
    (_code, _address, _int): (
        *("IDASetMaxNonlinIters", "IDASetMaxConvFails", "IDASetMaxOrd", "IDASetSuppressAlg"),
    ),
    (_code, _address, _long): ("IDASetMaxNumSteps",),
    (_code, _address, _real): (
        *("IDASetInitStep", "IDASetMinStep", "IDASetMaxStep", "IDASetStopTime"),
    ),
    (_code, _address, _real, *[_address] * 3, _int): ("IDASolve",),
    (_code, _address, _address): (
        *("N_VBufSize_Serial", "IDASetUserData", "IDASetJacFn", "IDASetId"),
        *("IDAGetNumErrTestFails", "IDAGetNumNonlinSolvConvFails", "IDAGetNumStepSolveFails"),
        *("IDAGetLastOrder", "IDAGetEstLocalErrors"),
    ),
}
# Calls through these prototypes release the interpreter lock.
PROTOTYPES = {
    name: ctypes.CFUNCTYPE(*signature) for signature, names in _SIGNATURES.items() for name in names
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
    images = _find_images()
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
        try:
            from sksundae import _cy_ida  # noqa: F401
        except ImportError as problem:
            raise UnavailableError(f"scikit-sundae has no compiled IDA: {problem}") from problem
        return _open_loaded_dlls(_windows_dll_names())
    try:
        # Symbols are also looked up in the libraries that the extension module is linked to. The
        # module itself is not imported, because it imports SciPy's optimizers, which takes a third
        # of a short run.
        images = [ctypes.CDLL(_find_extension_module())]
    except OSError as problem:
        raise UnavailableError(f"scikit-sundae's IDA cannot be opened: {problem}") from problem
    find_new_libraries()  # It is linked to a BLAS library.
    return images


def _find_extension_module() -> str:
    try:
        package = PathFinder.find_spec("sksundae")
    except ImportError as problem:
        raise UnavailableError(f"scikit-sundae cannot be found: {problem}") from problem
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
    if call.SUNDIALSGetVersionNumber(*map(ctypes.byref, numbers), label, len(label)) < 0:
        raise UnavailableError("SUNDIALS returns no version number")
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
        if second_half != _UNCHANGED:
            raise UnavailableError("SUNDIALS was built with indices of 64 bits, not 32")
        if size != _TEST_VECTOR_LENGTH * ctypes.sizeof(ctypes.c_double):
            raise UnavailableError(
                f"SUNDIALS has numbers of {size // _TEST_VECTOR_LENGTH} bytes, not of 8"
            )
    finally:
        if vector is not None:
            call.N_VDestroy(vector)
        call.SUNContext_Free(ctypes.byref(context))
