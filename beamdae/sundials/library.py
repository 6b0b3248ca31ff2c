"""The very SUNDIALS that scikit-sundae loads: a second copy would cost memory for nothing."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.machinery import PathFinder
from importlib.metadata import PackageNotFoundError, files
from pathlib import PurePath
from types import SimpleNamespace
from typing import Any

from beamdae.sundials.prototypes import PROTOTYPES, FunctionAddresses

_SUPPORTED_MAJOR_VERSION = 7
_TEST_VECTOR_LENGTH = 3


class UnavailableError(Exception):
    """Why SUNDIALS cannot be used by its C interface; scikit-sundae's own class is left."""


@dataclass(frozen=True)
class SundialsLibrary:
    """The functions of SUNDIALS, as addresses and to be called."""

    version: tuple[int, int, int]
    addresses: FunctionAddresses
    call: Any


@cache
def load_library() -> SundialsLibrary:
    """Find the functions in what scikit-sundae is linked to, and make sure of their types.

    Raises
    ------
    UnavailableError
        Where they are not there, or of another version, precision or index width.
    """
    images = _find_images()
    addresses = FunctionAddresses(
        *(_find_address(images, name) for name in FunctionAddresses._fields)
    )
    if any(hasattr(image, "MPI_Comm_rank") for image in images):
        raise UnavailableError("SUNDIALS was built with MPI")
    call = SimpleNamespace(
        **{name: PROTOTYPES[name](at) for name, at in addresses._asdict().items()}
    )
    version = _read_version(call)
    if version[0] != _SUPPORTED_MAJOR_VERSION:
        raise UnavailableError(
            f"SUNDIALS is {'.'.join(map(str, version))}, not {_SUPPORTED_MAJOR_VERSION}"
        )
    _check_widths(call)
    return SundialsLibrary(version, addresses, call)


def _find_images() -> list[ctypes.CDLL]:
    """What is searched for functions."""
    if sys.platform == "win32":
        try:
            from sksundae import _cy_ida  # noqa: F401
        except ImportError as problem:
            raise UnavailableError(f"scikit-sundae has no compiled IDA: {problem}") from problem
        return _open_loaded_dlls(_windows_dll_names())
    try:
        # A symbol is looked up in the libraries that the extension module is linked to as well. It
        # is not imported for that: scikit-sundae takes SciPy's optimizers along, a third of a run.
        return [ctypes.CDLL(_find_extension_module())]
    except OSError as problem:
        raise UnavailableError(f"scikit-sundae's IDA cannot be opened: {problem}") from problem


def _find_extension_module() -> str:
    """The file of scikit-sundae's compiled IDA."""
    package = PathFinder.find_spec("sksundae")
    places = package.submodule_search_locations if package else None
    module = PathFinder.find_spec("sksundae._cy_ida", places) if places else None
    if module is None or module.origin is None:
        raise UnavailableError("scikit-sundae has no compiled IDA")
    return module.origin


def _windows_dll_names() -> set[str]:
    """Names that SUNDIALS has on Windows, in scikit-sundae's wheel or in conda's environments."""
    parts = ("core", "ida", "nvecserial", "sunmatrixband", "sunlinsolband")
    try:
        wheel = {PurePath(file).name for file in files("scikit-sundae") or ()}
    except PackageNotFoundError:
        wheel = set()
    return {f"sundials_{part}.dll" for part in parts} | {
        name for name in wheel if "sundials_" in name and name.endswith(".dll")
    }


def _open_loaded_dlls(names: Iterable[str]) -> list[ctypes.CDLL]:
    """Libraries of these names that are loaded already."""
    kernel = ctypes.CDLL("kernel32")
    kernel.GetModuleHandleW.restype = ctypes.c_void_p
    kernel.GetModuleHandleW.argtypes = (ctypes.c_wchar_p,)
    handles = {name: kernel.GetModuleHandleW(name) for name in sorted(names)}
    return [ctypes.CDLL(name, handle=handle) for name, handle in handles.items() if handle]


def _find_address(images: Iterable[ctypes.CDLL], name: str) -> int:
    for image in images:
        if hasattr(image, name):
            at = ctypes.cast(getattr(image, name), ctypes.c_void_p).value
            assert at is not None
            return at
    raise UnavailableError(f"scikit-sundae's SUNDIALS has no function {name}")


def _read_version(call: Any) -> tuple[int, int, int]:
    numbers = [ctypes.c_int() for _ in range(3)]
    label = ctypes.create_string_buffer(64)
    if call.SUNDIALSGetVersionNumber(*map(ctypes.byref, numbers), label, len(label)) < 0:
        raise UnavailableError("SUNDIALS does not tell its version")
    major, minor, patch = (number.value for number in numbers)
    return major, minor, patch


def _check_widths(call: Any) -> None:
    """Make sure of double precision and 32-bit indices.

    The size of a vector in bytes is told as an index: it is right in any precision, and the second
    half of its place is left alone where indices have 32 bits.
    """
    context = ctypes.c_void_p()
    if call.SUNContext_Create(0, ctypes.byref(context)) < 0:
        raise UnavailableError("SUNDIALS makes no context")
    vector = None
    try:
        vector = call.N_VNew_Serial(_TEST_VECTOR_LENGTH, context)
        place = (ctypes.c_int32 * 2)(-1, -1)
        if vector is None or call.N_VBufSize_Serial(vector, place) < 0:
            raise UnavailableError("SUNDIALS makes no vector")
        size, untouched = place
        if untouched != -1:
            raise UnavailableError("SUNDIALS was built with indices of 64 bits, not 32")
        if size != _TEST_VECTOR_LENGTH * ctypes.sizeof(ctypes.c_double):
            raise UnavailableError(
                f"its numbers have {size // _TEST_VECTOR_LENGTH} bytes, not those of doubles"
            )
    finally:
        if vector is not None:
            call.N_VDestroy(vector)
        call.SUNContext_Free(ctypes.byref(context))
