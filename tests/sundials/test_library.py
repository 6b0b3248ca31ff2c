"""SUNDIALS functions come from the libraries that scikit-sundae loads."""

import ctypes
import sys
from pathlib import Path

import pytest
import sksundae

from beamdae.sundials import library as library_module
from beamdae.sundials.library import UnavailableError, load_library
from beamdae.sundials.prototypes import PROTOTYPES, FunctionAddresses


def test_every_function_has_a_prototype():
    assert set(FunctionAddresses._fields) == set(PROTOTYPES)
    assert len(FunctionAddresses._fields) == len(set(load_library().addresses))


def test_version_is_that_of_scikit_sundae():
    assert ".".join(map(str, load_library().version)) == sksundae.SUNDIALS_VERSION


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_functions_belong_to_the_one_loaded_copy():
    addresses = load_library().addresses
    lines = [line.split() for line in Path("/proc/self/maps").read_text().splitlines()]
    mapped = [line for line in lines if "libsundials_ida" in line[-1]]
    assert len({line[-1] for line in mapped}) == 1
    ranges = [[int(end, 16) for end in line[0].split("-")] for line in mapped]
    assert any(low <= addresses.IDASolve < high for low, high in ranges)


def catch_rejection():
    with pytest.raises(UnavailableError) as problem:
        load_library.__wrapped__()
    return str(problem.value)


def replace_functions(monkeypatch, **functions):
    """Replace some functions of SUNDIALS, and return the callbacks, which must stay alive."""
    callbacks_by_name = {name: PROTOTYPES[name](function) for name, function in functions.items()}
    original = library_module._find_address

    def address(images, name):
        if name in callbacks_by_name:
            return ctypes.cast(callbacks_by_name[name], ctypes.c_void_p).value
        return original(images, name)

    monkeypatch.setattr(library_module, "_find_address", address)
    return callbacks_by_name


def write_size(*halves):
    """Return a stand-in for N_VBufSize_Serial that writes these 32-bit halves."""

    def size(vector, place):
        memory = (ctypes.c_int32 * len(halves)).from_address(place)
        memory[:] = halves
        return 0

    return size


@pytest.mark.parametrize(
    ("halves", "message"),
    [
        ((12,), "SUNDIALS has numbers of 4 bytes, not of 8"),
        ((48,), "SUNDIALS has numbers of 16 bytes, not of 8"),
        ((24, 0), "SUNDIALS was built with indices of 64 bits, not 32"),
    ],
)
def test_other_precision_or_index_width_is_rejected(monkeypatch, halves, message):
    callbacks = replace_functions(monkeypatch, N_VBufSize_Serial=write_size(*halves))
    assert catch_rejection() == message
    assert callbacks


def test_other_version_is_rejected(monkeypatch):
    def version(major, minor, patch, label, length):
        for place, number in ((major, 8), (minor, 0), (patch, 1)):
            ctypes.c_int.from_address(place).value = number
        return 0

    callbacks = replace_functions(monkeypatch, SUNDIALSGetVersionNumber=version)
    assert catch_rejection() == "SUNDIALS is 8.0.1, not 7"
    assert callbacks


def test_build_with_mpi_is_rejected(monkeypatch):
    (image,) = library_module._find_images()
    monkeypatch.setattr(image, "MPI_Comm_rank", None, raising=False)
    monkeypatch.setattr(library_module, "_find_images", lambda: [image])
    assert catch_rejection() == "SUNDIALS was built with MPI"


def test_library_without_the_functions_is_rejected(monkeypatch):
    monkeypatch.setattr(library_module, "_find_images", lambda: [ctypes.CDLL(None)])
    assert catch_rejection() == "scikit-sundae's SUNDIALS has no function SUNDIALSGetVersionNumber"


def test_compiled_module_that_cannot_be_opened_is_reported(monkeypatch, tmp_path):
    monkeypatch.setattr(
        library_module, "_find_extension_module", lambda: str(tmp_path / "absent.so")
    )
    assert catch_rejection().startswith("scikit-sundae's IDA cannot be opened")


@pytest.mark.skipif(sys.platform == "win32", reason="there it is imported")
def test_missing_compiled_module_is_reported(monkeypatch, tmp_path):
    (tmp_path / "sksundae").mkdir()
    (tmp_path / "sksundae" / "__init__.py").touch()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert catch_rejection() == "scikit-sundae has no compiled IDA"
    monkeypatch.setattr(sys, "path", [])
    assert catch_rejection() == "scikit-sundae has no compiled IDA"


@pytest.mark.skipif(sys.platform == "win32", reason="there it is imported")
def test_opened_module_is_the_one_python_imports():
    assert library_module._find_extension_module() == sksundae._cy_ida.__file__


def test_names_on_windows():
    names = library_module._windows_dll_names()
    assert "sundials_ida.dll" in names
