"""SUNDIALS functions come from the libraries that scikit-sundae loads."""

import sys
from pathlib import Path

import pytest
import sksundae

from beamdae.sundials import UnavailableError, load_library


def test_version_is_that_of_scikit_sundae():
    assert ".".join(map(str, load_library().version)) == sksundae.SUNDIALS_VERSION


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_functions_belong_to_the_one_loaded_copy():
    addresses = load_library().addresses
    lines = [line.split() for line in Path("/proc/self/maps").read_text().splitlines()]
    mapped = [line for line in lines if "libsundials_ida" in line[-1]]
    assert len({line[-1] for line in mapped}) == 1
    ranges = [[int(end, 16) for end in line[0].split("-")] for line in mapped]
    assert any(low <= addresses["IDASolve"] < high for low, high in ranges)


def catch_rejection():
    with pytest.raises(UnavailableError) as problem:
        load_library.__wrapped__()
    return str(problem.value)


@pytest.mark.skipif(sys.platform == "win32", reason="there it is imported")
def test_missing_compiled_module_is_reported(monkeypatch, tmp_path):
    (tmp_path / "sksundae").mkdir()
    (tmp_path / "sksundae" / "__init__.py").touch()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert catch_rejection() == "scikit-sundae has no compiled IDA"
    monkeypatch.setattr(sys, "path", [])
    assert catch_rejection() == "scikit-sundae has no compiled IDA"
