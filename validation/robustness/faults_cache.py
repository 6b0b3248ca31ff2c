"""Faults of the cache of compiled kernels: results are always those without a compiler."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from robustness.bench import (
    Bench,
    NotPossibleError,
    expect,
    prepared,
    small_disk,
    told,
    unprivileged,
)


def _libraries(bench: Bench) -> list[Path]:
    found = sorted((bench.folder / "cache" / "beamdae").glob("*.so"))
    expect(bool(found), "no library was cached")
    return found


def _fill(bench: Bench) -> None:
    bench.env |= {"XDG_CACHE_HOME": str(bench.folder / "cache"), "BEAMDAE_NATIVE": "off"}
    bench.env.pop("CC", None)
    bench.simulated()
    right = bench.rows
    bench.env.pop("BEAMDAE_NATIVE")
    bench.simulated()
    expect(bench.rows == right, "compiled kernels give other results")


def _filled(bench: Bench) -> str:
    """The table by the virtual machine, and a cache with the libraries for it."""
    if shutil.which("cc") is None:
        raise NotPossibleError("no C compiler")
    prepared(bench, _fill)
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "cache")
    bench.env.pop("CC", None)
    return bench.rows


def _same_after(bench: Bench, right: str, limit: float = 60.0) -> None:
    bench.simulated(limit=limit)
    expect(bench.rows == right, "the results are others")


def _damaged(bench: Bench, content: bytes) -> None:
    right = _filled(bench)
    for library in _libraries(bench):
        library.write_bytes(content)
    _same_after(bench, right)


def truncated_library(bench: Bench) -> None:
    """A library of which half is missing is not used."""
    right = _filled(bench)
    for library in _libraries(bench):
        library.write_bytes(library.read_bytes()[: library.stat().st_size // 2])
    _same_after(bench, right)


def library_of_random_bytes(bench: Bench) -> None:
    """A library that is none is not used."""
    _damaged(bench, os.urandom(5000))


def empty_library(bench: Bench) -> None:
    """An empty library is not used."""
    _damaged(bench, b"")


def another_functions_library(bench: Bench) -> None:
    """A library by the name of another one is not used."""
    right = _filled(bench)
    libraries = _libraries(bench)
    kept = [library.read_bytes() for library in libraries]
    for library, other in zip(libraries, kept[1:] + kept[:1], strict=True):
        library.write_bytes(other)
    _same_after(bench, right)


_FALSE = """
import sys
import subprocess
import casadi as ca
from pathlib import Path
for library in map(Path, sys.argv[1:]):
    name = library.name.split("-")[0]
    true = ca.external(name, str(library))
    inputs = [ca.SX.sym(f"i{k}", true.sparsity_in(k)) for k in range(true.n_in())]
    outputs = [ca.SX(true.sparsity_out(k), 0.5) for k in range(true.n_out())]
    false = ca.Function(name, inputs, outputs)
    code = ca.CodeGenerator("false.c")
    code.add(false)
    code.generate()
    subprocess.run(["cc", "-shared", "-fPIC", "false.c", "-o", "false.so"], check=True)
    Path("false.so").replace(library)
"""


def _falsified(bench: Bench) -> str:
    right = _filled(bench)
    script = bench.write("falsify.py", _FALSE)
    names = [str(path) for path in _libraries(bench)]
    made = bench.start([bench.command()[0], str(script), *names])
    expect(bench.finish(made).code == 0, "the false libraries could not be made")
    return right


def false_library(bench: Bench) -> None:
    """A valid library that computes something else is not used."""
    _same_after(bench, _falsified(bench))


def cache_others_may_write(bench: Bench) -> None:
    """Libraries in a folder that others may write are not trusted."""
    right = _falsified(bench)
    (bench.folder / "cache" / "beamdae").chmod(0o777)
    _same_after(bench, right)


def cache_of_another_user(bench: Bench) -> None:
    """Libraries in another user's folder are not trusted."""
    if os.geteuid() != 0:
        raise NotPossibleError("only root may give a folder away")
    right = _falsified(bench)
    for path in [bench.folder / "cache" / "beamdae", *_libraries(bench)]:
        os.chown(path, 65534, 65534)
    _same_after(bench, right)


def new_cache_is_private(bench: Bench) -> None:
    """A folder made for the cache is for its user alone, whatever the mask."""
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "cache")
    ran = bench.shell("umask 0; BEAMDAE run model.py --no-estimate")
    told(ran, 0)
    mode = (bench.folder / "cache" / "beamdae").stat().st_mode & 0o777
    expect(mode == 0o700, f"its mode is {mode:o}")


def directory_for_a_library(bench: Bench) -> None:
    """A folder by the name of a library is passed over."""
    right = _filled(bench)
    for library in _libraries(bench):
        library.unlink()
        library.mkdir()
    _same_after(bench, right)


def relative_cache(bench: Bench) -> None:
    """A relative XDG_CACHE_HOME is not a place, as its specification says."""
    right = _filled(bench)
    bench.env |= {"XDG_CACHE_HOME": "relative", "HOME": str(bench.folder / "home")}
    _same_after(bench, right)
    expect(not (bench.folder / "relative").exists(), "a cache was made where the command ran")


def cache_in_a_file(bench: Bench) -> None:
    """A cache that cannot be a folder is done without."""
    right = _filled(bench)
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "model.py")
    _same_after(bench, right)


def read_only_cache(bench: Bench) -> None:
    """A cache that cannot be written is done without."""
    right = _filled(bench)
    locked = bench.folder / "locked"
    locked.mkdir()
    locked.chmod(0o555)
    bench.env["XDG_CACHE_HOME"] = str(locked)
    command = bench.command("run", "model.py", "--no-estimate")
    told(bench.finish(bench.start(unprivileged(bench, command))), 0)
    expect(bench.rows == right, "the results are others")


def full_disk_of_the_cache(bench: Bench) -> None:
    """A cache without room is done without, and nothing half written stays."""
    right = _filled(bench)
    disk = bench.folder / "disk"
    with small_disk(disk, 8):
        bench.env["XDG_CACHE_HOME"] = str(disk)
        _same_after(bench, right)
        expect(not list(disk.glob("beamdae/tmp*")), "scratch files stay in the cache")


def _compiler(bench: Bench, name: str, script: str) -> str:
    path = bench.write(name, f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


def _with_compiler(bench: Bench, compiler: str, limit: float = 60.0) -> None:
    right = _filled(bench)
    bench.env |= {"XDG_CACHE_HOME": str(bench.folder / "other cache"), "CC": compiler}
    _same_after(bench, right, limit)
    scratch = [p for p in (bench.folder / "other cache").rglob("*") if "tmp" in p.name]
    expect(not scratch, "scratch files stay in the cache")


def unbalanced_compiler(bench: Bench) -> None:
    """CC='gcc "' is done without."""
    _with_compiler(bench, 'gcc "')


def missing_compiler(bench: Bench) -> None:
    """A CC that does not exist is done without."""
    _with_compiler(bench, "no-such-compiler")


def failing_compiler(bench: Bench) -> None:
    """CC=false is done without."""
    _with_compiler(bench, "false")


def compiler_of_nothing(bench: Bench) -> None:
    """A compiler that succeeds and writes nothing is done without."""
    _with_compiler(bench, _compiler(bench, "nothing", "exit 0"))


def compiler_of_garbage(bench: Bench) -> None:
    """A compiler that writes what is no library is done without."""
    script = 'for last; do :; done; echo garbage > "$last"'
    _with_compiler(bench, _compiler(bench, "garbage", script))


def compiler_that_hangs(bench: Bench) -> None:
    """A compiler that does not end is waited for once, and a minute at most."""
    _with_compiler(bench, _compiler(bench, "hanging", "exec sleep 1000"), limit=100.0)


def fast_math(bench: Bench) -> None:
    """Flags that change results do not: they are the same to the last bit."""
    _with_compiler(bench, "cc -ffast-math -O3")


def two_at_once(bench: Bench) -> None:
    """Two runs that begin with one empty cache both succeed."""
    right = _filled(bench)
    shutil.rmtree(bench.folder / "cache")
    command = bench.command("run", "model.py", "--no-estimate", "--out")
    both = [bench.start([*command, f"out {k}"]) for k in range(2)]
    for ran in [bench.finish(one) for one in both]:
        told(ran, 0)
    for k in range(2):
        rows = (bench.folder / f"out {k}" / "arm.csv").read_text()
        expect(rows == right, "the results are others")


def unknown_switch(bench: Bench) -> None:
    """BEAMDAE_NATIVE of anything runs, and says so if it is not understood."""
    right = _filled(bench)
    bench.env["BEAMDAE_NATIVE"] = "perhaps"
    _same_after(bench, right)


FAULTS = (
    truncated_library,
    library_of_random_bytes,
    empty_library,
    another_functions_library,
    false_library,
    cache_others_may_write,
    cache_of_another_user,
    new_cache_is_private,
    directory_for_a_library,
    relative_cache,
    cache_in_a_file,
    read_only_cache,
    full_disk_of_the_cache,
    unbalanced_compiler,
    missing_compiler,
    failing_compiler,
    compiler_of_nothing,
    compiler_of_garbage,
    fast_math,
    two_at_once,
    unknown_switch,
)
SLOW = (compiler_that_hangs,)
