"""Compiled kernels: whatever the cache holds and CC says, nothing falls over or changes numbers."""

import os
import shutil
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
from beamdae.symbolic import compiler, kernel_cache
from beamdae.symbolic import native as module
from beamdae.symbolic.native import native

X = ca.SX.sym("x", 3)
FUNCTION = ca.Function("kernel_of_test", [X], [ca.sin(X) * X[0] + ca.sqrt(X)])
OTHER = ca.Function("kernel_of_test", [X], [ca.cos(X)])
POINT = np.array([0.3, 1.7, 2.9])
NOBODY = 65534

pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler"),
    pytest.mark.skipif(os.name != "posix", reason="other systems have no such permissions"),
]
root = pytest.mark.skipif(
    os.name != "posix" or os.geteuid() != 0, reason="root alone acts as other users"
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own for each test, and a process in which nothing went wrong yet."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("BEAMDAE_NATIVE", raising=False)
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(module, "_failed", set())
    monkeypatch.setattr(module, "_said", set())
    return tmp_path / "cache" / "beamdae"


def values(function):
    return np.ravel(np.array(function(POINT)))


def is_compiled(function):
    return function.class_name() == "External"


def libraries(cache):
    return sorted(cache.glob("*.so"))


def assert_compiled(function=FUNCTION):
    """It is, and in silence."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = native(function)
    assert is_compiled(found)
    assert_array_equal(values(found), values(function))


def assert_done_without(words, function=FUNCTION):
    """The virtual machine is taken, with one sentence the first time and none the second."""
    with pytest.warns(KernelWarning, match=words) as told:
        found = native(function)
    assert len(told) == 1
    sentence = str(told[0].message)
    assert sentence.endswith(".")
    assert "\n" not in sentence
    assert not is_compiled(found)
    assert_array_equal(values(found), values(function))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not is_compiled(native(function))


def compile_by(script, tmp_path, monkeypatch):
    """A compiler of a few lines of shell, in a folder with a space in its name."""
    file = tmp_path / "my tools" / "cc"
    file.parent.mkdir(exist_ok=True)
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(0o700)
    monkeypatch.setenv("CC", f"'{file}'")


def replace_by(damage, library):
    """Put what is damaged in the place of a library, which this process may have mapped."""
    content = library.read_bytes()
    library.unlink()
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
        library.symlink_to("nowhere")
    elif damage == "link to a device":
        library.symlink_to("/dev/zero")
    elif damage == "pipe":
        os.mkfifo(library)
    elif damage == "folder":
        (library / "inside").mkdir(parents=True)
    else:
        library.write_bytes(contents[damage])
        library.chmod(0o000 if damage == "unreadable" else 0o700)


def test_a_kernel_is_built_once_and_gives_the_same_bits(cache, monkeypatch):
    assert_compiled()
    assert len(libraries(cache)) == 1
    monkeypatch.setattr(compiler.Compiler, "build", None)
    assert_compiled()


@pytest.mark.parametrize(
    "damage",
    [
        "empty",
        "a byte short",
        "a bit",
        "unreadable",
        "dangling link",
        "pipe",
        "folder",
        # As those above, at the cost of one more build each.
        *(
            pytest.param(damage, marks=pytest.mark.slow)
            for damage in ("cut", "a byte long", "random", "link to a device")
        ),
    ],
)
def test_a_damaged_kernel_is_built_again(cache, damage):
    native(FUNCTION)
    (library,) = libraries(cache)
    content = library.read_bytes()
    replace_by(damage, library)
    assert_compiled()
    assert libraries(cache) == [library]
    assert library.read_bytes() == content


def test_the_library_of_another_kernel_by_that_name_is_not_loaded(cache):
    native(FUNCTION)
    native(OTHER)
    one, other = (library.read_bytes() for library in libraries(cache))
    for library, content in zip(libraries(cache), (other, one), strict=True):
        library.unlink()
        library.write_bytes(content)
    assert_compiled(FUNCTION)
    assert_compiled(OTHER)


def test_a_name_with_the_checksum_of_another_kernel_is_not_loaded(cache):
    native(FUNCTION)
    (mine,) = libraries(cache)
    native(OTHER)
    (other,) = set(libraries(cache)) - {mine}
    wrong = mine.name.rpartition("-")[0] + "-" + other.name.rpartition("-")[2]
    other.rename(cache / wrong)
    mine.unlink()
    assert_compiled()


def test_a_damaged_kernel_is_replaced_and_never_written_over(cache):
    loaded = native(FUNCTION)
    (library,) = libraries(cache)
    keeper = library.with_name("keeper")
    os.link(library, keeper)
    library.unlink()
    library.write_bytes(b"damaged")
    before = library.stat().st_ino
    native(FUNCTION)
    assert library.stat().st_ino != before
    assert keeper.read_bytes() == library.read_bytes()
    assert_array_equal(values(loaded), values(FUNCTION))


def test_what_a_killed_build_left_is_removed_by_a_later_one(cache):
    native(FUNCTION)
    for name in ("build-dead", "build-alive"):
        (cache / name).mkdir()
        (cache / name / "kernel.c").write_text("")
    hours_ago = time.time() - 7200.0
    os.utime(cache / "build-dead", (hours_ago, hours_ago))
    native(OTHER)
    assert not (cache / "build-dead").exists()
    assert (cache / "build-alive" / "kernel.c").exists()


# Compilers.


def test_a_hanging_compiler_is_stopped_with_its_children_and_tried_once(
    cache, tmp_path, monkeypatch
):
    monkeypatch.setattr(compiler, "_PATIENCE", 0.3)
    compile_by(f"sleep 61 & echo $! >'{tmp_path}/child'; wait", tmp_path, monkeypatch)
    assert_done_without(r"my tools/cc: .* more than 0\.3 s.*BEAMDAE_NATIVE=off")
    begin = time.perf_counter()
    assert not is_compiled(native(OTHER))
    assert time.perf_counter() - begin < 0.2
    assert list(cache.iterdir()) == []
    assert_ends(int((tmp_path / "child").read_text()))


def assert_ends(process):
    for _ in range(500):
        said = subprocess.run(["ps", "-o", "stat=", "-p", str(process)], capture_output=True)
        if said.stdout.strip()[:1] in (b"", b"Z"):
            return
        time.sleep(0.01)
    pytest.fail("it still runs")


def test_an_interrupt_stops_the_compiler_and_leaves_nothing(cache, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    compile_by(f"echo $$ >'{tmp_path}/compiler'; exec sleep 61", tmp_path, monkeypatch)
    stop = compiler._stop
    waited = []
    monkeypatch.setattr(subprocess.Popen, "wait", interrupted)
    monkeypatch.setattr(compiler, "_stop", waited.append)
    with pytest.raises(KeyboardInterrupt):
        native(FUNCTION)
    monkeypatch.undo()
    stop(*waited)
    assert waited[0].returncode < 0
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize(
    "flag",
    [
        "-ffast-math",
        "-Ofast",
        "-O3",
        "-funsafe-math-optimizations",
        "-fassociative-math",
        "-ffp-contract=fast",
        "-mfma",
        "-march=native",
        "-mfpmath=387",
        "@flags",
        "-specs=mine",
        "-Dsin=cos",
        "-include",
        "-Xclang",
        "-fplugin=mine.so",
        "-wrapper",
    ],
)
def test_flags_in_cc_that_may_change_results_are_refused(monkeypatch, flag):
    monkeypatch.setenv("CC", f"cc -m64 {flag}")
    assert_done_without(f"CC=cc -m64 {flag}: {flag} may change results, allowed are")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ('gcc "', 'CC=gcc ": a quote in it is not closed'),
        ("no-such-compiler -m64", "there is no program no-such-compiler"),
        ("/", "there is no program /"),
        ("false", "false: it cannot compile kernels"),
        ("true", "true: it leaves no library"),
    ],
)
def test_a_cc_that_is_no_compiler_is_done_without(cache, monkeypatch, command, words):
    monkeypatch.setenv("CC", command)
    assert_done_without(words)
    assert not libraries(cache)


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ('for x; do :; done; : >"$x"', "it leaves no library"),
        ('for x; do :; done; echo ELF >"$x"', "what it builds cannot be loaded"),
        ("echo mine: no license >&2; exit 3", r"cannot compile kernels \(mine: no license\)"),
        ("kill -9 $$", "cannot compile kernels"),
        (
            'for x; do case "$x" in *.c) sed -i "s/sin(/cos(/" "$x";; esac; done; exec cc "$@"',
            "do not give the same numbers",
        ),
    ],
)
def test_a_compiler_that_fails_in_its_own_way_is_done_without(
    cache, tmp_path, monkeypatch, script, words
):
    compile_by(script, tmp_path, monkeypatch)
    assert_done_without(words)
    assert not libraries(cache)


@pytest.mark.parametrize("command", ["", " ", "env cc", "cc -pipe", "cc -isystem /usr/include"])
def test_wrappers_and_flags_of_places_are_taken(monkeypatch, command):
    monkeypatch.setenv("CC", command)
    assert_compiled()


def test_a_compiler_that_talks_in_a_folder_with_a_space_is_taken(tmp_path, monkeypatch):
    compile_by('echo on stdout; echo a warning >&2; exec cc "$@"', tmp_path, monkeypatch)
    assert_compiled()


# Others.


@pytest.mark.parametrize("mask", [0o000, 0o002, 0o022, 0o077])
def test_the_cache_is_for_its_user_alone_whatever_the_umask(cache, tmp_path, mask):
    tmp_path.chmod(0o700)
    before = os.umask(mask)
    try:
        assert_compiled()
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert stat.S_IMODE(libraries(cache)[0].stat().st_mode) == 0o700


def test_a_cache_of_ours_that_others_could_write_to_is_closed_to_them(cache):
    native(FUNCTION)
    cache.chmod(0o777)
    libraries(cache)[0].chmod(0o722)
    assert_compiled()
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert stat.S_IMODE(libraries(cache)[0].stat().st_mode) == 0o700


def in_the_open(monkeypatch):
    """Folders of the tests are for their user alone, which protects all that is below."""
    monkeypatch.setattr(kernel_cache, "_OTHERS_ENTER", -1)


def test_a_way_to_the_cache_that_others_can_change_is_refused(cache, monkeypatch):
    native(FUNCTION)
    planted = libraries(cache)[0]
    cache.parent.chmod(0o777)
    in_the_open(monkeypatch)
    assert_done_without(r"others can write to .*cache; set XDG_CACHE_HOME to a folder")
    assert planted.exists()
    module._said.clear()
    cache.parent.chmod(0o1777)
    assert_compiled()


def test_a_folder_of_the_user_alone_protects_what_is_below(cache, tmp_path):
    native(FUNCTION)
    cache.parent.chmod(0o777)
    tmp_path.chmod(0o700)
    assert_compiled()


@root
@pytest.mark.parametrize("whose", ["folder", "way", "link"])
def test_what_belongs_to_another_user_is_not_loaded(cache, tmp_path, monkeypatch, whose):
    native(FUNCTION)
    if whose == "link":
        cache.rename(tmp_path / "theirs")
        cache.symlink_to(tmp_path / "theirs")
    theirs = {"folder": cache, "way": cache.parent, "link": tmp_path / "theirs"}[whose]
    in_the_open(monkeypatch)
    os.chown(theirs, NOBODY, NOBODY)
    assert_done_without("belongs to another user")


@root
def test_a_library_of_another_user_is_built_again(cache):
    native(FUNCTION)
    (library,) = libraries(cache)
    os.chown(library, NOBODY, NOBODY)
    assert_compiled()
    assert library.stat().st_uid == 0


# Places.


def test_a_relative_cache_home_is_ignored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert_compiled()
    assert not Path("relative").exists()
    assert libraries(tmp_path / "home" / ".cache" / "beamdae")


def test_a_user_without_a_home_does_without(monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", homeless)
    assert_done_without("no home folder, set HOME")


def test_a_home_that_cannot_be_written_is_done_without(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/proc/self")
    assert_done_without("kernels cannot be kept there")


@pytest.mark.parametrize("what", ["root", "folder", "link"])
def test_a_cache_that_is_no_folder_is_done_without(cache, what):
    place = cache.parent if what == "root" else cache
    place.parent.mkdir(exist_ok=True)
    place.symlink_to("nowhere") if what == "link" else place.write_text("")
    assert_done_without("kernels cannot be kept there")


@pytest.mark.parametrize("call", ["replace", "fsync"])
def test_a_full_disk_leaves_nothing_behind(cache, monkeypatch, call):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, full)
    assert_done_without("No space left on device")
    assert list(cache.iterdir()) == []


def test_systems_without_owners_of_files_are_served(monkeypatch):
    monkeypatch.delattr(os, "geteuid")
    assert_compiled()
    assert_compiled()


PROCESS = """
import warnings
warnings.simplefilter("error")
import casadi as ca, numpy as np
from beamdae.symbolic.native import native
x = ca.SX.sym("x", 3)
found = native(ca.Function("kernel_of_test", [x], [ca.sin(x) * x[0] + ca.sqrt(x)]))
print(found.class_name(), np.array(found([0.3, 1.7, 2.9])).ravel().tolist())
"""


@pytest.mark.slow(reason="starts six processes")
def test_processes_that_build_at_once_get_the_same(cache):
    command = [sys.executable, "-c", PROCESS]
    all_of_them = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(6)]
    said = {process.communicate(timeout=120)[0] for process in all_of_them}
    assert said == {f"External {values(FUNCTION).tolist()}\n"}
    assert [path.suffix for path in cache.iterdir()] == [".so"]


@root
@pytest.mark.slow(reason="mounts a file system, starts processes")
@pytest.mark.parametrize("options", ["size=8k", "ro", "noexec"])
def test_file_systems_that_hold_no_kernel_are_done_without(tmp_path, options):
    """A full one, one to be read alone, and one whose files are not executed."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = f"mount -t tmpfs -o {options},mode=700 none '{place}'"
    can = subprocess.run(["unshare", "-m", "sh", "-c", mount], capture_output=True)
    if can.returncode:
        pytest.skip(f"nothing can be mounted: {can.stderr.decode().strip()}")
    script = f'{mount} && XDG_CACHE_HOME="{place}" exec "$0" -c "$1"'
    quiet = PROCESS.replace('"error"', '"default"')
    run = subprocess.run(
        ["unshare", "-m", "sh", "-c", script, sys.executable, quiet],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert run.stdout == f"SXFunction {values(FUNCTION).tolist()}\n", run.stderr
    assert run.stderr.count("KernelWarning") == 1
    assert "Traceback" not in run.stderr
