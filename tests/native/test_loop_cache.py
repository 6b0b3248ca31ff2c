"""Cached loops: identified by everything they consist of, loaded without numba."""

import importlib.util
import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from beamdae.native import loops

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def new_process(cache, monkeypatch):
    """A new cache for each test, and a process that has not loaded loops yet."""
    monkeypatch.setattr(loops, "_loaded_objects", {})


MODULE = """
from dataclasses import dataclass
import numpy as np
from beamdae.native.loops import CompiledLoop
from beamdae.native.loop_functions import fill

FACTOR, SHARES, TABLE = 2, (1.0, 2.0), np.array([4.0, 8.0])

@dataclass
class Work:
    numbers: np.ndarray
    total: float = 0.0

def increment(number):
    return number + 1.0

def halve(number):
    return increment(number) / 2.0

def loop_of_test(work):
    fill(work.numbers, 3.0)
    for number in work.numbers:
        work.total += FACTOR * halve(number) + SHARES[1] * TABLE[1]
    return 0

def run():
    work = Work(np.zeros(4))
    CompiledLoop(loop_of_test, work)()
    return work.total
"""
TOTAL = 4 * (2 * 2.0 + 2.0 * 8.0)


def run(folder, text=MODULE):
    """Return the total that a new module with this text computes."""
    file = folder / f"module_{len(list(folder.iterdir()))}.py"
    file.write_text(text)
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look up types there.
    sys.modules[file.stem] = module
    try:
        spec.loader.exec_module(module)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return module.run()
    finally:
        del sys.modules[file.stem]


@pytest.mark.slow(reason="a quarter of a second")
def test_loop_is_compiled_once(tmp_path, cache, builds):
    assert [run(tmp_path) for _ in range(2)] == [TOTAL, TOTAL]
    assert len(builds) == 1
    assert [file.name.split("-")[0] for file in cache.iterdir()] == ["loop_of_test"]


CHANGES = [
    ("FACTOR, SHARES, TABLE = 2,", "FACTOR, SHARES, TABLE = 3,", 4 * (3 * 2.0 + 16.0)),
    ("FACTOR, SHARES, TABLE = 2,", "FACTOR, SHARES, TABLE = 2.5,", 4 * (2.5 * 2.0 + 16.0)),
    ("(1.0, 2.0)", "(1.0, 3.0)", 4 * (4.0 + 24.0)),
    ("[4.0, 8.0]", "[4.0, 9.0]", 4 * (4.0 + 18.0)),
    ("number + 1.0", "number + 2.0", 4 * (2 * 2.5 + 16.0)),
    ("/ 2.0", "/ 4.0", 4 * (2.0 + 16.0)),
    ("numbers: np.ndarray", "numbers: np.ndarray\n    more: float = 0.0", TOTAL),
]


@pytest.mark.slow(reason="half a second and more")
def test_changed_loop_is_compiled_again(tmp_path, builds):
    assert run(tmp_path) == TOTAL
    for old, new, total in CHANGES:
        assert old in MODULE
        assert run(tmp_path, MODULE.replace(old, new)) == total
    assert len(builds) == 1 + len(CHANGES)


@pytest.mark.slow(reason="half a second")
def test_loop_of_another_numba_is_not_loaded(tmp_path, builds, monkeypatch):
    assert run(tmp_path) == TOTAL
    monkeypatch.setattr(loops, "installed_version", lambda name: "0.0")
    loops._describe_compiler.cache_clear()
    assert run(tmp_path) == TOTAL
    assert len(builds) == 2
    loops._describe_compiler.cache_clear()


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("damage", ["cut", "a text", "another loop"])
def test_damaged_loop_is_compiled_again(tmp_path, cache, builds, damage):
    run(tmp_path)
    (file,) = cache.iterdir()
    damaged = {"cut": file.read_bytes()[:-100], "a text": b"return 0\n"}
    if damage == "another loop":
        run(tmp_path, MODULE.replace("= 2,", "= 3,"))
        (other,) = set(cache.iterdir()) - {file}
        damaged[damage] = other.read_bytes()
        other.unlink()
    file.write_bytes(damaged[damage])
    del builds[:]
    assert [run(tmp_path) for _ in range(2)] == [TOTAL, TOTAL]
    assert len(builds) == 1
    # Under any name: numba does not produce the same bytes twice.
    (file,) = cache.iterdir()
    assert file.read_bytes() != damaged[damage]


# Without numba.

SCRIPT = """
import sys
import beamdae.native.loops as loops
from module_of_test import run, loop_of_test, Work
import numpy as np
for _ in range(2):
    try:
        print(run())
    except loops.MachineCodeError:
        print("no machine code")
print("numba" in sys.modules)
"""


def run_in_new_process(folder, env=None, missing=("numba",), raising="ImportError('it is broken')"):
    """Run the loop twice in a process in which modules cannot be imported."""
    (folder / "module_of_test.py").write_text(MODULE)
    for name in missing:
        (folder / f"{name}.py").write_text(f"raise {raising}\n")
    paths = os.pathsep.join([str(folder), str(ROOT)])
    process = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        env={**os.environ, "PYTHONPATH": paths, **(env or {})},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert process.returncode == 0, process.stderr
    return process.stdout.split("\n")[:-1], process.stderr


@pytest.mark.slow(reason="starts a process")
def test_cached_loop_is_loaded_without_numba(tmp_path):
    assert run(tmp_path) == TOTAL
    lines, errors = run_in_new_process(tmp_path)
    assert lines == [f"{TOTAL}", f"{TOTAL}", "False"]
    assert errors == ""


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    ("missing", "raising"),
    [
        ("numba", "ImportError('it is broken')"),
        ("numba", "ModuleNotFoundError('it is broken')"),
        ("llvmlite", "ImportError('it is broken')"),
        ("llvmlite", "OSError('it is broken')"),
    ],
)
def test_missing_numba_or_llvmlite_gives_one_warning(tmp_path, missing, raising):
    lines, errors = run_in_new_process(tmp_path, missing=[missing], raising=raising)
    assert lines == ["no machine code", "no machine code", "False"]
    assert errors.count("KernelWarning") == 1
    kind = raising.split("(")[0]
    assert f"{missing} cannot be imported ({kind}: it is broken); runs take" in errors
    assert "Traceback" not in errors


@pytest.mark.slow(reason="half a second")
def test_native_off_neither_compiles_nor_warns(tmp_path):
    lines, errors = run_in_new_process(tmp_path, {"BEAMDAE_NATIVE": "off"}, missing=[])
    assert lines == ["no machine code", "no machine code", "False"]
    assert errors == ""
