"""The cache of machine code: whatever it holds, nothing falls over or changes numbers."""

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

from beamdae.errors import KernelWarning
from beamdae.native import llvm as machine
from beamdae.native import object_cache as module
from beamdae.native import object_code as objects
from beamdae.native.lane_kernels import LANE_WIDTH, build_lane_kernel

S, X = ca.SX.sym("s"), ca.SX.sym("x", 3)
FUNCTION = ca.Function("kernel_of_test", [S, X], [ca.sin(X) * X[0] + ca.sqrt(X) * S])
OTHER = ca.Function("kernel_of_test", [S, X], [ca.cos(X)])
POINT = np.tile([[0.3], [1.7], [2.9]], LANE_WIDTH)
NOBODY = 65534

pytestmark = pytest.mark.skipif(os.name != "posix", reason="other systems have no such permissions")
root = pytest.mark.skipif(
    os.name != "posix" or os.geteuid() != 0, reason="root alone acts as other users"
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own for each test, and a process in which nothing went wrong yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("BEAMDAE_NATIVE", raising=False)
    monkeypatch.setattr(objects, "_issued_messages", set())
    return tmp_path / "cache" / "beamdae"


@pytest.fixture
def builds(monkeypatch):
    """Names of what LLVM compiles."""
    compiled, found = machine.compile_module, []

    def counted(ir, level):
        found.append(ir)
        return compiled(ir, level)

    monkeypatch.setattr(machine, "compile_module", counted)
    return found


def expected(function):
    return function(1.5, POINT[:, :1]).full()[:, 0]


def values(kernel):
    found = kernel(np.array([1.5]), POINT)
    assert_array_equal(found, np.tile(found[:, :1], LANE_WIDTH))
    return found[:, 0]


def kept(cache):
    return sorted(cache.glob("*.o"))


def assert_right(function=FUNCTION):
    """It is machine code, in silence."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kernel = build_lane_kernel(function)
    assert_array_equal(values(kernel), expected(function))


def assert_one_sentence(told):
    assert len(told) == 1
    sentence = str(told[0].message)
    assert sentence.endswith(" (BEAMDAE_NATIVE=off switches machine code off).")
    assert "\n" not in sentence


def assert_not_kept(words, builds):
    """Kernels are compiled each time, with one sentence the first time and none the second."""
    before = len(builds)
    with pytest.warns(KernelWarning, match=words) as told:
        kernel = build_lane_kernel(FUNCTION)
    assert_one_sentence(told)
    assert "each run compiles its loops" in str(told[0].message)
    assert_array_equal(values(kernel), expected(FUNCTION))
    assert_right()
    assert len(builds) == before + 2


def assert_done_without(words):
    """There is none, with one sentence the first time and none the second."""
    with pytest.warns(KernelWarning, match=words) as told:
        assert build_lane_kernel(FUNCTION) is None
    assert_one_sentence(told)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert build_lane_kernel(FUNCTION) is None


def replace_by(damage, file):
    """Put what is damaged in the place of an object."""
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


def test_a_kernel_is_built_once(cache, builds):
    assert_right()
    assert_right()
    assert len(builds) == len(kept(cache)) == 1


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
def test_a_damaged_kernel_is_built_again(cache, builds, damage):
    build_lane_kernel(FUNCTION)
    (file,) = kept(cache)
    content = file.read_bytes()
    replace_by(damage, file)
    assert_right()
    # Root reads it all the same.
    assert len(builds) == (1 if damage == "unreadable" and os.geteuid() == 0 else 2)
    assert kept(cache) == [file]
    assert not file.is_symlink()
    assert file.read_bytes() == content


def test_the_object_of_another_kernel_by_that_name_is_not_loaded(cache):
    build_lane_kernel(FUNCTION)
    build_lane_kernel(OTHER)
    one, other = (file.read_bytes() for file in kept(cache))
    for file, content in zip(kept(cache), (other, one), strict=True):
        file.write_bytes(content)
    assert_right(FUNCTION)
    assert_right(OTHER)


def test_an_object_with_the_checksum_of_another_kernel_is_not_loaded(cache, builds):
    build_lane_kernel(FUNCTION)
    (mine,) = kept(cache)
    build_lane_kernel(OTHER)
    (other,) = set(kept(cache)) - {mine}
    mine.write_bytes(other.read_bytes()[:32] + mine.read_bytes()[32:])
    assert_right()
    assert len(builds) == 3


def test_what_changes_between_check_and_use_is_not_loaded(cache, monkeypatch):
    """What is checked is what is loaded."""
    build_lane_kernel(FUNCTION)
    (file,) = kept(cache)
    read = module._read_private_file

    def replaced_after(place):
        content = read(place)
        place.write_bytes(b"not an object")
        return content

    monkeypatch.setattr(module, "_read_private_file", replaced_after)
    assert_right()
    assert file.read_bytes() == b"not an object"


def test_a_damaged_kernel_is_replaced_and_never_written_over(cache):
    build_lane_kernel(FUNCTION)
    (file,) = kept(cache)
    keeper = file.with_name("keeper")
    file.write_bytes(b"damaged")
    os.link(file, keeper)
    build_lane_kernel(FUNCTION)
    assert keeper.read_bytes() == b"damaged"
    assert file.read_bytes() != b"damaged"


def test_what_a_killed_build_left_is_removed_by_a_later_one(cache):
    build_lane_kernel(FUNCTION)
    for name in ("build-dead", "build-alive"):
        (cache / name).write_text("")
    (cache / "build-folder").mkdir()
    hours_ago = time.time() - 7200.0
    for name in ("build-dead", "build-folder"):
        os.utime(cache / name, (hours_ago, hours_ago))
    build_lane_kernel(OTHER)
    assert [path.name for path in cache.glob("build-*")] == ["build-alive"]


def test_an_interrupt_leaves_nothing(cache, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build_lane_kernel(FUNCTION)
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize("part", range(4))
def test_objects_of_other_machines_and_compilers_are_not_loaded(cache, builds, monkeypatch, part):
    build_lane_kernel(FUNCTION)
    recipe = list(machine.describe_target())
    recipe[part] += "x"
    monkeypatch.setattr(machine, "describe_target", lambda: tuple(recipe))
    assert_right()
    assert len(builds) == len(kept(cache)) == 2


# Others.


@pytest.mark.parametrize("mask", [0o000, 0o002, 0o022, 0o077])
def test_the_cache_is_for_its_user_alone_whatever_the_umask(cache, tmp_path, mask):
    tmp_path.chmod(0o700)
    before = os.umask(mask)
    try:
        assert_right()
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert stat.S_IMODE(kept(cache)[0].stat().st_mode) == 0o600


def test_a_cache_of_ours_that_others_could_write_to_is_closed_to_them(cache, builds):
    build_lane_kernel(FUNCTION)
    cache.chmod(0o777)
    kept(cache)[0].chmod(0o722)
    assert_right()
    assert len(builds) == 2
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert stat.S_IMODE(kept(cache)[0].stat().st_mode) == 0o600


def in_the_open(monkeypatch):
    """Folders of the tests are for their user alone, which protects all that is below."""
    monkeypatch.setattr(module, "_OTHERS_ENTER", -1)


def test_a_way_to_the_cache_that_others_can_change_is_refused(cache, builds, monkeypatch):
    build_lane_kernel(FUNCTION)
    planted = kept(cache)[0]
    cache.parent.chmod(0o777)
    in_the_open(monkeypatch)
    assert_not_kept(r"others can write to .*cache; set XDG_CACHE_HOME to a private folder", builds)
    assert planted.exists()
    objects._issued_messages.clear()
    cache.parent.chmod(0o1777)
    assert_right()
    assert len(builds) == 3


def test_a_folder_of_the_user_alone_protects_what_is_below(cache, tmp_path, builds):
    build_lane_kernel(FUNCTION)
    cache.parent.chmod(0o777)
    tmp_path.chmod(0o700)
    assert_right()
    assert len(builds) == 1


@root
@pytest.mark.parametrize("whose", ["folder", "way", "link"])
def test_what_belongs_to_another_user_is_not_loaded(cache, tmp_path, builds, monkeypatch, whose):
    build_lane_kernel(FUNCTION)
    if whose == "link":
        cache.rename(tmp_path / "theirs")
        cache.symlink_to(tmp_path / "theirs")
    theirs = {"folder": cache, "way": cache.parent, "link": tmp_path / "theirs"}[whose]
    in_the_open(monkeypatch)
    os.chown(theirs, NOBODY, NOBODY)
    assert_not_kept("belongs to another user", builds)


@root
def test_an_object_of_another_user_is_built_again(cache, builds):
    build_lane_kernel(FUNCTION)
    (file,) = kept(cache)
    os.chown(file, NOBODY, NOBODY)
    assert_right()
    assert len(builds) == 2
    assert file.stat().st_uid == 0


# Places.


def test_a_relative_cache_home_is_ignored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert_right()
    assert not Path("relative").exists()
    assert kept(tmp_path / "home" / ".cache" / "beamdae")


def test_a_user_without_a_home_does_without(monkeypatch, builds):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", homeless)
    assert_not_kept("no home folder; set HOME", builds)


def test_a_home_that_cannot_be_written_is_done_without(monkeypatch, builds):
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/proc/self")
    assert_not_kept("kernels cannot be cached", builds)


@pytest.mark.parametrize("what", ["root", "folder", "link"])
def test_a_cache_that_is_no_folder_is_done_without(cache, builds, what):
    place = cache.parent if what == "root" else cache
    place.parent.mkdir(exist_ok=True)
    place.symlink_to("nowhere") if what == "link" else place.write_text("")
    assert_not_kept("kernels cannot be cached", builds)


@pytest.mark.parametrize("call", ["replace", "fsync"])
def test_a_full_disk_leaves_nothing_behind(cache, builds, monkeypatch, call):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, full)
    assert_not_kept("No space left on device", builds)
    assert list(cache.iterdir()) == []


def test_systems_without_owners_of_files_are_served(builds, monkeypatch):
    monkeypatch.delattr(os, "geteuid")
    assert_right()
    assert_right()
    assert len(builds) == 1


# Machines.


def test_a_kernel_that_gives_other_numbers_is_done_without(cache, monkeypatch):
    compiled = machine.compile_module
    monkeypatch.setattr(
        machine, "compile_module", lambda ir, level: compiled(ir.replace("fadd", "fsub"), level)
    )
    assert_done_without("LLVM: kernel_of_test returns wrong numbers; runs take several")
    assert not kept(cache)


def test_a_system_that_executes_nothing_from_memory_is_done_without(monkeypatch):
    def forbidden(*_):
        raise machine.MachineCodeError("this system executes nothing that was not installed")

    monkeypatch.setattr(machine, "_engine", forbidden)
    assert_done_without("this system executes nothing that was not installed; runs take several")


def test_what_is_not_wanted_is_neither_built_nor_told(cache, monkeypatch):
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
kernel = build_lane_kernel(ca.Function("kernel_of_test", [s, x], [ca.sin(x) * x[0] + ca.sqrt(x) * s]))
print(kernel([1.5], np.tile([[0.3], [1.7], [2.9]], 8))[:, 0].tolist())
"""


@pytest.mark.slow(reason="starts six processes")
def test_processes_that_build_at_once_get_the_same(cache):
    command = [sys.executable, "-c", PROCESS]
    all_of_them = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(6)]
    said = {process.communicate(timeout=120)[0] for process in all_of_them}
    assert said == {f"{expected(FUNCTION).tolist()}\n"}
    assert [path.suffix for path in cache.iterdir()] == [".o"]


@root
@pytest.mark.slow(reason="mounts a file system, starts processes")
@pytest.mark.parametrize(("options", "sentences"), [("size=4k", 1), ("ro", 1), ("noexec", 0)])
def test_file_systems_that_hold_no_kernel_are_done_without(tmp_path, options, sentences):
    """A full one, and one to be read alone; nothing is executed from files."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = f"mount -t tmpfs -o {options},mode=700 none '{place}'"
    fill = f"echo >'{place}/full'" if options.startswith("size") else "true"
    can = subprocess.run(["unshare", "-m", "sh", "-c", mount], capture_output=True)
    if can.returncode:
        pytest.skip(f"nothing can be mounted: {can.stderr.decode().strip()}")
    script = f'{mount} && {fill} && XDG_CACHE_HOME="{place}" exec "$0" -c "$1"'
    quiet = PROCESS.replace('"error"', '"default"')
    run = subprocess.run(
        ["unshare", "-m", "sh", "-c", script, sys.executable, quiet],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.stdout == f"{expected(FUNCTION).tolist()}\n", run.stderr
    assert run.stderr.count("KernelWarning") == sentences
    assert "Traceback" not in run.stderr
