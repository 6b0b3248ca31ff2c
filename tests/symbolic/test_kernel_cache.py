"""Compiled kernels on disk: nothing damaged, foreign or inexact is ever loaded."""

import os
import shutil
import stat
import subprocess
import time
import warnings

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from beamdae.errors import KernelWarning
from beamdae.symbolic import compiler
from beamdae.symbolic import native as module
from beamdae.symbolic.kernel_cache import cache_folder
from beamdae.symbolic.native import native

X = ca.SX.sym("x", 3)
FUNCTION = ca.Function("kernel_of_test", [X], [ca.sin(X) * X[0] + ca.sqrt(X)])
OTHER = ca.Function("kernel_of_test", [X], [ca.cos(X)])
POINT = np.array([0.3, 1.7, 2.9])

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
posix = pytest.mark.skipif(os.name != "posix", reason="other systems have no such permissions")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own for each test, and nothing given up before."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("BEAMDAE_NATIVE", "on")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(module, "_given_up", set())
    return tmp_path / "cache" / "beamdae"


def is_native(function):
    return function.class_name() == "External"


def values(function):
    return np.ravel(np.array(function(POINT)))


def libraries(cache):
    return sorted(cache.glob("*.so"))


def warned(words, function=FUNCTION):
    with pytest.warns(KernelWarning, match=words) as said:
        found = native(function)
    assert len(said) == 1
    assert str(said[0].message).endswith(".")
    assert "\n" not in str(said[0].message)
    assert not is_native(found)
    assert_array_equal(values(found), values(function))


def script(tmp_path, monkeypatch, text):
    """A compiler of a few lines of shell."""
    file = tmp_path / "my cc"
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o700)
    monkeypatch.setenv("CC", f"'{file}'")


def test_kernels_are_compiled_once_and_give_the_same_bits(cache, monkeypatch):
    first = native(FUNCTION)
    assert is_native(first)
    assert_array_equal(values(first), values(FUNCTION))
    monkeypatch.setattr(compiler.Compiler, "build", None)
    assert is_native(native(FUNCTION))
    assert len(libraries(cache)) == 1


@posix
def test_the_cache_is_for_its_user_alone(cache):
    before = os.umask(0)
    try:
        native(FUNCTION)
    finally:
        os.umask(before)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert stat.S_IMODE(libraries(cache)[0].stat().st_mode) == 0o700


def damaged_by(library, kind):
    """Replace a library, never in place: this process may have it mapped."""
    content = library.read_bytes()
    library.unlink()
    if kind == "missing link":
        library.symlink_to(library.with_name("nowhere"))
    elif kind == "folder":
        (library / "inside").mkdir(parents=True)
    else:
        library.write_bytes(
            {
                "empty": b"",
                "cut": content[: len(content) // 2],
                "cut by a byte": content[:-1],
                "longer": content + b"\0",
                "random": np.random.default_rng(0).bytes(len(content)),
                "a bit": content[:5000] + bytes([content[5000] ^ 1]) + content[5001:],
            }[kind]
        )
        library.chmod(0o700)


@pytest.mark.parametrize(
    "kind",
    ["empty", "cut", "cut by a byte", "longer", "random", "a bit", "missing link", "folder"],
)
def test_a_damaged_kernel_is_built_again(cache, kind):
    native(FUNCTION)
    (library,) = libraries(cache)
    content = library.read_bytes()
    damaged_by(library, kind)
    again = native(FUNCTION)
    assert is_native(again)
    assert_array_equal(values(again), values(FUNCTION))
    assert libraries(cache) == [library]
    assert library.read_bytes() == content


def test_a_library_of_another_kernel_by_that_name_is_not_loaded(cache):
    native(FUNCTION)
    native(OTHER)
    one, other = libraries(cache)
    for name in (one, other):
        content = (other if name == one else one).read_bytes()
        name.unlink()
        name.write_bytes(content)
        name.chmod(0o700)
    assert_array_equal(values(native(FUNCTION)), values(FUNCTION))
    assert_array_equal(values(native(OTHER)), values(OTHER))


def test_a_compiler_that_computes_something_else_is_found_out(cache, tmp_path, monkeypatch):
    script(
        tmp_path,
        monkeypatch,
        'for x; do case "$x" in *.c) sed -i "s/sin(/cos(/" "$x";; esac; done; exec cc "$@"',
    )
    warned("compute something else")
    assert libraries(cache) == []


@posix
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722])
def test_a_cache_others_may_write_to_is_not_used(cache, mode):
    native(FUNCTION)
    cache.chmod(mode)
    warned("others may write to")


@posix
def test_a_folder_above_that_others_may_write_to_is_told(cache, tmp_path):
    native(FUNCTION)
    (tmp_path / "cache").chmod(0o777)
    warned("others may write to")


@posix
@pytest.mark.skipif(os.name == "posix" and os.getuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize("what", ["folder", "above", "file"])
def test_what_another_user_owns_is_not_loaded(cache, tmp_path, what):
    native(FUNCTION)
    (library,) = libraries(cache)
    place = {"folder": cache, "above": tmp_path / "cache", "file": library}[what]
    os.chown(place, 65534, 65534)
    if what == "file":
        assert is_native(native(FUNCTION))
        assert libraries(cache)[0].stat().st_uid == os.getuid()
    else:
        warned("belongs to another user")


@posix
def test_a_library_others_may_write_to_is_built_again(cache):
    native(FUNCTION)
    (library,) = libraries(cache)
    library.chmod(0o722)
    assert is_native(native(FUNCTION))
    assert stat.S_IMODE(libraries(cache)[0].stat().st_mode) == 0o700


def test_a_relative_cache_is_no_place(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "beamdae"


def test_a_cache_that_is_a_file_is_done_without(cache, tmp_path):
    (tmp_path / "cache").write_text("")
    warned("kernels cannot be kept there")


def test_a_full_disk_is_done_without(cache, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    warned("No space left on device")
    assert list(cache.iterdir()) == []


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ('gcc "', "a quote is not closed"),
        ("no-such-compiler", "there is no command 'no-such-compiler'"),
        ("cc -ffast-math", "'-ffast-math' may change results"),
        ("cc -Ofast", "'-Ofast' may change results"),
        ("cc -m64 -ffp-contract=fast", "may change results"),
        ("cc -mfma", "may change results"),
        ("cc -march=native", "may change results"),
        ("cc @flags", "may change results"),
        ("false", "it ends with code 1"),
        ("true", "it leaves no library"),
    ],
)
def test_a_compiler_that_cannot_be_used_is_done_without(monkeypatch, command, words):
    monkeypatch.setenv("CC", command)
    warned(words)
    with warnings.catch_warnings():
        # It is told once.
        warnings.simplefilter("error")
        assert not is_native(native(FUNCTION))


@pytest.mark.parametrize("command", ["cc -m64", "cc -pipe -isystem /usr/include", "env cc"])
def test_harmless_options_and_wrappers_are_taken(monkeypatch, command):
    if os.uname().machine != "x86_64" and "-m64" in command:
        pytest.skip("-m64 is an option of x86_64")
    monkeypatch.setenv("CC", command)
    assert is_native(native(FUNCTION))


def still_runs(process):
    """Whether it does; one that ended may stay in the table until somebody asks for it."""
    said = subprocess.run(["ps", "-o", "stat=", "-p", str(process)], capture_output=True, text=True)
    return bool(said.stdout.strip()) and not said.stdout.strip().startswith("Z")


def test_a_compiler_that_hangs_is_waited_for_once_and_ended(cache, tmp_path, monkeypatch):
    monkeypatch.setattr(compiler, "_PATIENCE", 0.3)
    script(tmp_path, monkeypatch, f"sleep 61 & echo $! > '{tmp_path}/child'; wait")
    warned("does not end within 0.3 s")
    child = int((tmp_path / "child").read_text())
    for _ in range(300):
        if not still_runs(child):
            break
        time.sleep(0.01)
    assert not still_runs(child)
    begin = time.perf_counter()
    assert not is_native(native(OTHER))
    assert time.perf_counter() - begin < 0.2
    assert list(cache.iterdir()) == []


def test_what_a_killed_build_left_is_removed_later(cache):
    native(FUNCTION)
    old, new = cache / "build-old", cache / "build-new"
    for folder in (old, new):
        folder.mkdir()
        (folder / "kernel.c").write_text("")
    os.utime(old, (0, 0))
    native(OTHER)
    assert not old.exists()
    assert new.exists()
