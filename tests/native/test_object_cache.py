"""Cache of objects: damaged or foreign files never change results or stop a run."""

import os
import stat
import subprocess
import sys
import time
import warnings
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from beamdae import errors
from beamdae.errors import KernelWarning
from beamdae.native import llvm, object_code
from beamdae.native.lane_kernels import LANE_WIDTH, build_lane_kernel

S, X = ca.SX.sym("s"), ca.SX.sym("x", 3)
FUNCTION = ca.Function("kernel_of_test", [S, X], [ca.sin(X) * X[0] + ca.sqrt(X) * S])
OTHER = ca.Function("kernel_of_test", [S, X], [ca.cos(X)])
POINT = np.tile([[0.3], [1.7], [2.9]], LANE_WIDTH)
OTHER_USER = 65534

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="requires POSIX permissions"),
    pytest.mark.usefixtures("cache"),
]
root = pytest.mark.skipif(
    os.name != "posix" or os.geteuid() != 0, reason="requires root to act as other users"
)


def expected(function):
    return function(1.5, POINT[:, :1]).full()[:, 0]


def values(kernel):
    result = kernel(np.array([1.5]), POINT)
    assert_array_equal(result, np.tile(result[:, :1], LANE_WIDTH))
    return result[:, 0]


def cached_objects(cache):
    return sorted(cache.glob("*.o"))


def assert_machine_code_is_right(function=FUNCTION):
    """The kernel is available, right, and built without warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kernel = build_lane_kernel(function)
    assert_array_equal(values(kernel), expected(function))


def assert_one_warning_on_one_line(warned):
    assert len(warned) == 1
    sentence = str(warned[0].message)
    assert sentence.endswith(" (BEAMDAE_NATIVE=off switches machine code off).")
    assert "\n" not in sentence


def assert_works_without_cache(words, builds):
    """Kernels are compiled each time; the first time there is one warning."""
    before = len(builds)
    with pytest.warns(KernelWarning, match=words) as warned:
        kernel = build_lane_kernel(FUNCTION)
    assert_one_warning_on_one_line(warned)
    assert "each process compiles kernels again" in str(warned[0].message)
    assert_array_equal(values(kernel), expected(FUNCTION))
    assert_machine_code_is_right()
    assert len(builds) == before + 2


def assert_falls_back(words):
    """There is no kernel; the first time there is one warning."""
    with pytest.warns(KernelWarning, match=words) as warned:
        assert build_lane_kernel(FUNCTION) is None
    assert_one_warning_on_one_line(warned)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert build_lane_kernel(FUNCTION) is None


def damage_object(damage, file):
    """Replace an object by a damaged one."""
    content = file.read_bytes()
    file.unlink()
    middle = len(content) // 2
    contents = {
        "empty": b"",
        "cut": content[:middle],
        "a byte short": content[:-1],
        "a byte long": content + b"\0",
        "random": np.random.default_rng(0).bytes(len(content)),
        "a bit": content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :],
        "unreadable": content,
    }
    if damage == "dangling link":
        file.symlink_to("nowhere")
    elif damage == "link to a copy":
        file.with_name("copy").write_bytes(content)
        file.symlink_to("copy")
    elif damage == "link to a device":
        file.symlink_to("/dev/zero")
    elif damage == "pipe":
        os.mkfifo(file)
    elif damage == "folder":
        (file / "inside").mkdir(parents=True)
    else:
        file.write_bytes(contents[damage])
        file.chmod(0o000 if damage == "unreadable" else 0o600)


def test_kernel_is_compiled_once(cache, builds):
    assert_machine_code_is_right()
    assert_machine_code_is_right()
    assert len(builds) == len(cached_objects(cache)) == 1


@pytest.mark.parametrize(
    "damage",
    [
        "empty",
        "cut",
        "a byte short",
        "a byte long",
        "random",
        "a bit",
        "unreadable",
        "dangling link",
        "link to a copy",
        "link to a device",
        "pipe",
        "folder",
    ],
)
def test_damaged_object_is_compiled_again(cache, builds, damage):
    build_lane_kernel(FUNCTION)
    (file,) = cached_objects(cache)
    content = file.read_bytes()
    damage_object(damage, file)
    assert_machine_code_is_right()
    # Root can read it.
    assert len(builds) == (1 if damage == "unreadable" and os.geteuid() == 0 else 2)
    assert cached_objects(cache) == [file]
    assert not file.is_symlink()
    assert file.read_bytes() == content


def test_object_of_another_kernel_with_that_name_is_not_loaded(cache):
    build_lane_kernel(FUNCTION)
    build_lane_kernel(OTHER)
    one, other = (file.read_bytes() for file in cached_objects(cache))
    for file, content in zip(cached_objects(cache), (other, one), strict=True):
        file.write_bytes(content)
    assert_machine_code_is_right(FUNCTION)
    assert_machine_code_is_right(OTHER)


def test_object_with_the_checksum_of_another_kernel_is_not_loaded(cache, builds):
    build_lane_kernel(FUNCTION)
    (own_file,) = cached_objects(cache)
    build_lane_kernel(OTHER)
    (other,) = set(cached_objects(cache)) - {own_file}
    own_file.write_bytes(other.read_bytes()[:32] + own_file.read_bytes()[32:])
    assert_machine_code_is_right()
    assert len(builds) == 3


def test_change_between_check_and_use_has_no_effect(cache, monkeypatch):
    build_lane_kernel(FUNCTION)
    (file,) = cached_objects(cache)
    read_file = object_code._read_private_file

    def replaced_after(path):
        content = read_file(path)
        path.write_bytes(b"not an object")
        return content

    monkeypatch.setattr(object_code, "_read_private_file", replaced_after)
    assert_machine_code_is_right()
    assert file.read_bytes() == b"not an object"


def test_damaged_object_is_replaced_by_a_new_file(cache):
    build_lane_kernel(FUNCTION)
    (file,) = cached_objects(cache)
    keeper = file.with_name("keeper")
    file.write_bytes(b"damaged")
    os.link(file, keeper)
    build_lane_kernel(FUNCTION)
    assert keeper.read_bytes() == b"damaged"
    assert file.read_bytes() != b"damaged"


def test_files_of_killed_builds_are_removed_later(cache):
    build_lane_kernel(FUNCTION)
    for name in ("build-dead", "build-alive"):
        (cache / name).write_text("")
    (cache / "build-folder").mkdir()
    hours_ago = time.time() - 7200.0
    for name in ("build-dead", "build-folder"):
        os.utime(cache / name, (hours_ago, hours_ago))
    build_lane_kernel(OTHER)
    assert [path.name for path in cache.glob("build-*")] == ["build-alive"]


def test_interrupt_leaves_no_file(cache, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build_lane_kernel(FUNCTION)
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize("part", range(4))
def test_objects_of_other_machines_and_compilers_are_not_loaded(cache, builds, monkeypatch, part):
    build_lane_kernel(FUNCTION)
    recipe = list(llvm.describe_target())
    recipe[part] += "x"
    monkeypatch.setattr(llvm, "describe_target", lambda: tuple(recipe))
    assert_machine_code_is_right()
    assert len(builds) == len(cached_objects(cache)) == 2


# Other users.


@pytest.mark.parametrize("mask", [0o000, 0o002, 0o022, 0o077])
def test_cache_is_private_for_any_umask(cache, tmp_path, mask):
    tmp_path.chmod(0o700)
    before = os.umask(mask)
    try:
        assert_machine_code_is_right()
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert stat.S_IMODE(cached_objects(cache)[0].stat().st_mode) == 0o600


def test_permissions_of_a_writable_cache_are_restricted(cache, builds):
    build_lane_kernel(FUNCTION)
    cache.chmod(0o777)
    cached_objects(cache)[0].chmod(0o722)
    assert_machine_code_is_right()
    assert len(builds) == 2
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert stat.S_IMODE(cached_objects(cache)[0].stat().st_mode) == 0o600


def ignore_private_parents(monkeypatch):
    """Ignore that the folders of tests are private, which protects everything below them."""
    monkeypatch.setattr(object_code, "_OTHERS_ENTER", -1)


def test_cache_below_a_folder_that_others_can_write_to_is_rejected(cache, builds, monkeypatch):
    build_lane_kernel(FUNCTION)
    planted = cached_objects(cache)[0]
    cache.parent.chmod(0o777)
    ignore_private_parents(monkeypatch)
    assert_works_without_cache(
        r"others can write to .*cache; set XDG_CACHE_HOME to a private folder", builds
    )
    assert planted.exists()
    errors._issued_messages.clear()
    cache.parent.chmod(0o1777)
    assert_machine_code_is_right()
    assert len(builds) == 3


def test_private_folder_protects_folders_below_it(cache, tmp_path, builds):
    build_lane_kernel(FUNCTION)
    cache.parent.chmod(0o777)
    tmp_path.chmod(0o700)
    assert_machine_code_is_right()
    assert len(builds) == 1


@root
@pytest.mark.parametrize("location", ["folder", "parent", "link"])
def test_cache_of_another_user_is_not_loaded(cache, tmp_path, builds, monkeypatch, location):
    build_lane_kernel(FUNCTION)
    if location == "link":
        cache.rename(tmp_path / "foreign")
        cache.symlink_to(tmp_path / "foreign")
    foreign = {"folder": cache, "parent": cache.parent, "link": tmp_path / "foreign"}[location]
    ignore_private_parents(monkeypatch)
    os.chown(foreign, OTHER_USER, OTHER_USER)
    assert_works_without_cache("belongs to another user", builds)


@root
def test_object_of_another_user_is_compiled_again(cache, builds):
    build_lane_kernel(FUNCTION)
    (file,) = cached_objects(cache)
    os.chown(file, OTHER_USER, OTHER_USER)
    assert_machine_code_is_right()
    assert len(builds) == 2
    assert file.stat().st_uid == 0


# Location.


def test_relative_cache_home_is_ignored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert_machine_code_is_right()
    assert not Path("relative").exists()
    assert cached_objects(tmp_path / "home" / ".cache" / "beamdae")


def test_user_without_home_works_without_cache(monkeypatch, builds):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", homeless)
    assert_works_without_cache("no home folder; set HOME", builds)


def test_read_only_home_works_without_cache(monkeypatch, builds):
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/proc/self")
    assert_works_without_cache("machine code cannot be cached", builds)


@pytest.mark.parametrize("what", ["root", "folder", "link"])
def test_cache_that_is_not_a_folder_works_without_cache(cache, builds, what):
    path = cache.parent if what == "root" else cache
    path.parent.mkdir(exist_ok=True)
    path.symlink_to("nowhere") if what == "link" else path.write_text("")
    assert_works_without_cache("machine code cannot be cached", builds)


@pytest.mark.parametrize("call", ["replace", "fsync"])
def test_full_disk_leaves_no_file(cache, builds, monkeypatch, call):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, full)
    assert_works_without_cache("No space left on device", builds)
    assert list(cache.iterdir()) == []


def test_systems_without_file_owners_are_supported(builds, monkeypatch):
    monkeypatch.delattr(os, "geteuid")
    assert_machine_code_is_right()
    assert_machine_code_is_right()
    assert len(builds) == 1


# Systems.


def test_kernel_with_wrong_numbers_falls_back(cache, monkeypatch):
    compile_module = llvm.compile_module
    monkeypatch.setattr(
        llvm, "compile_module", lambda ir, level: compile_module(ir.replace("fadd", "fsub"), level)
    )
    assert_falls_back("LLVM: kernel_of_test returns wrong numbers; runs take several")
    assert not cached_objects(cache)


def test_system_that_forbids_executable_memory_falls_back(monkeypatch):
    def forbidden(*_):
        raise llvm.MachineCodeError("this system forbids running code from memory")

    monkeypatch.setattr(llvm, "_engine", forbidden)
    assert_falls_back("this system forbids running code from memory; runs take several")


def test_native_off_neither_compiles_nor_warns(cache, monkeypatch):
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/self/nothing")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert build_lane_kernel(FUNCTION) is None


PROCESS = """
import warnings
warnings.simplefilter("error")
import casadi as ca, numpy as np
from beamdae.native.lane_kernels import build_lane_kernel
s, x = ca.SX.sym("s"), ca.SX.sym("x", 3)
function = ca.Function("kernel_of_test", [s, x], [ca.sin(x) * x[0] + ca.sqrt(x) * s])
kernel = build_lane_kernel(function)
print(kernel([1.5], np.tile([[0.3], [1.7], [2.9]], 8))[:, 0].tolist())
"""


@pytest.mark.slow(reason="starts six processes")
def test_concurrent_processes_get_the_same_kernel(cache):
    command = [sys.executable, "-c", PROCESS]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(6)]
    outputs = {process.communicate(timeout=120)[0] for process in processes}
    assert outputs == {f"{expected(FUNCTION).tolist()}\n"}
    assert [path.suffix for path in cache.iterdir()] == [".o"]


@root
@pytest.mark.slow(reason="mounts a file system, starts processes")
@pytest.mark.parametrize(("options", "sentences"), [("size=4k", 1), ("ro", 1), ("noexec", 0)])
def test_full_and_read_only_file_systems_work_without_cache(tmp_path, options, sentences):
    """Full or read-only; noexec does not matter, as nothing is executed from files."""
    path = tmp_path / "disk"
    path.mkdir()
    mount = f"mount -t tmpfs -o {options},mode=700 none '{path}'"
    fill = f"echo >'{path}/full'" if options.startswith("size") else "true"
    mounted = subprocess.run(["unshare", "-m", "sh", "-c", mount], capture_output=True)
    if mounted.returncode:
        pytest.skip(f"nothing can be mounted: {mounted.stderr.decode().strip()}")
    script = f'{mount} && {fill} && XDG_CACHE_HOME="{path}" exec "$0" -c "$1"'
    program = PROCESS.replace('"error"', '"default"')
    run = subprocess.run(
        ["unshare", "-m", "sh", "-c", script, sys.executable, program],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.stdout == f"{expected(FUNCTION).tolist()}\n", run.stderr
    assert run.stderr.count("KernelWarning") == sentences
    assert "Traceback" not in run.stderr


RUN = """
import beamdae as bd
mech = bd.Mechanism(gravity=(0.0, -9.81))
section = bd.Section.circle(bd.Material(E=2e11, nu=0.3, rho=7800.0), diameter=0.01)
beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=2, nodes=7))
mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
states = bd.simulate(mech, bd.Radau(), t_end=1e-3).trajectory.intervals[0].rows
print(*(x[0].tobytes().hex() for x in states))
"""


@pytest.mark.slow(reason="compiles the core and kernels")
def test_first_runs_have_the_bits_of_later_ones():
    """Elements of many nodes started in CasADi's virtual machine until their loops were cached."""
    command = [sys.executable, "-W", "ignore", "-c", RUN]
    first, later = (
        subprocess.run(command, capture_output=True, text=True, check=True).stdout for _ in range(2)
    )
    assert first == later != ""
