"""Objects compiled with the package: found on all machines of a level, checked, never required."""

import hashlib
import warnings

import llvmlite.binding
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from test_object_cache import FUNCTION, OTHER

from beamdae.native import lane_kernels, llvm, object_code
from beamdae.native.lane_kernels import LANE_WIDTH, build_lane_kernel

POINT = np.tile([[0.3], [1.7], [2.9]], LANE_WIDTH)

is_x86_level = llvm.host_target().cpu in llvm.X86_LEVELS


@pytest.fixture(autouse=True)
def empty_package(cache, tmp_path, monkeypatch):
    """A new cache and a package without objects for each test."""
    monkeypatch.setattr(object_code, "FOLDER", tmp_path / "package")
    object_code._file_names.cache_clear()
    yield
    object_code._file_names.cache_clear()


def record_source(function, monkeypatch):
    """Return the source of the machine code of a function, without compiling it."""
    sources = []
    with monkeypatch.context() as patch:
        patch.setattr(lane_kernels, "load_object", lambda source, *_: sources.append(source))
        build_lane_kernel(function)
    return sources[0]


def prebuild(source, content):
    """Add an object to the package."""
    folder = object_code.FOLDER / object_code.target_folder(llvm.host_target())
    folder.mkdir(parents=True, exist_ok=True)
    object_code.write_prebuilt_object(folder, source.identity, source.name, content)
    return next(folder.iterdir())


def assert_machine_code_is_right():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kernel = build_lane_kernel(FUNCTION)
    assert_array_equal(kernel([1.5], POINT)[:, 0], FUNCTION(1.5, POINT[:, :1]).full()[:, 0])


def test_prebuilt_kernel_is_loaded_and_cached_without_compiling(monkeypatch, cache, builds):
    source = record_source(FUNCTION, monkeypatch)
    prebuild(source, source.compile())
    del builds[:]
    assert_machine_code_is_right()
    assert not builds
    assert [file.suffix for file in cache.iterdir()] == [".o"]


def test_prebuilt_kernel_is_loaded_where_compiling_must_wait(monkeypatch):
    """Equilibria interpret kernels until compiling them pays off."""
    source = record_source(FUNCTION, monkeypatch)
    assert build_lane_kernel(FUNCTION, compiles=False) is None
    prebuild(source, source.compile())
    object_code._file_names.cache_clear()
    assert build_lane_kernel(FUNCTION, compiles=False) is not None


@pytest.mark.parametrize("damage", ["another kernel", "unknown symbol", "cut", "missing"])
def test_unusable_prebuilt_object_is_compiled_instead(monkeypatch, builds, damage):
    source, other = (record_source(x, monkeypatch) for x in (FUNCTION, OTHER))
    content = (other if damage == "another kernel" else source).compile()
    if damage == "unknown symbol":
        # As a wheel that was built with a later C library.
        name = source.name
        ir = (
            f"declare void @missing()\ndefine void @{name}() {{\ncall void @missing()\nret void\n}}"
        )
        content = llvm.compile_module(ir, 0)
    file = prebuild(source, content)
    object_code.has_prebuilt_objects(llvm.host_target())
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-20])
    elif damage == "missing":
        file.unlink()
    del builds[:]
    assert_machine_code_is_right()
    assert len(builds) == 1


@pytest.mark.skipif(not is_x86_level, reason="requires an x86-64 processor")
def test_kernels_of_all_levels_return_the_same_bits(monkeypatch):
    source = record_source(FUNCTION, monkeypatch)
    host = llvm.host_target()
    executable = llvm.X86_LEVELS[: llvm.X86_LEVELS.index(host.cpu) + 1]
    values, contents = [], set()
    for cpu in executable:
        content = llvm.compile_module(source.ir(), source.level, host._replace(cpu=cpu))
        contents.add(hashlib.sha256(content).digest())
        code = source.load(content)
        kernel = lane_kernels.LaneKernel(
            FUNCTION.name(), code.addresses[FUNCTION.name()], 1, 3, 3, code
        )
        values.append(kernel([1.5], POINT))
    assert len(contents) == len(executable)
    for value in values[1:]:
        assert_array_equal(value, values[0])


FEATURES = set().union(*llvm._X86_LEVELS.values())


@pytest.mark.parametrize(
    ("missing", "cpu"),
    [
        ((), "x86-64-v4"),
        (("avx512vl",), "x86-64-v3"),
        (("fma",), "x86-64-v2"),
        # An incomplete lower level counts, even with AVX-512.
        (("sse4.1",), "core"),
    ],
)
def test_target_is_the_highest_complete_level(monkeypatch, missing, cpu):
    class Features(dict):
        def flatten(self):
            return "+some"

    features = Features({name: name not in missing for name in FEATURES})
    monkeypatch.setattr(llvmlite.binding, "get_process_triple", lambda: "x86_64-pc-linux-musl")
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_features", lambda: features)
    monkeypatch.setattr(llvmlite.binding, "get_host_cpu_name", lambda: "core")
    target = llvm.host_target.__wrapped__()
    assert target.cpu == cpu
    assert target.features == ("+some" if cpu == "core" else "")
    assert object_code.target_folder(target).as_posix() == f"x86_64-linux/{cpu}"


def test_systems_have_separate_objects():
    triples = ["x86_64-unknown-linux-gnu", "x86_64-apple-darwin", "x86_64-pc-windows-msvc"]
    folders = {object_code.target_folder(llvm.Target(x, "x86-64-v3")) for x in triples}
    assert len(folders) == 3
