"""Faults of the cache of machine code, and of what makes it: results are always the right ones."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from beamdae.native.llvm import compile_module
from robustness.bench import (
    ROOT,
    Bench,
    NotPossibleError,
    Ran,
    expect,
    prepared,
    small_disk,
    told,
    unprivileged,
)

# Runs in a compiled loop, with steps that do not depend on rounding.
_RUN = ("--integrator", "generalized-alpha")
# Compiling everything on a machine that has other things to do.
_LIMIT = 150.0
_FALSE = """
define void @{name}(ptr %shared, ptr %local, ptr %out, i64 %padded) {{
  store double 0.5, ptr %out
  ret void
}}
define i32 @loop(ptr %table) {{ ret i32 0 }}
"""


def _objects(bench: Bench, loops: bool | None = None) -> list[Path]:
    """Files of the cache: of loops, of kernels, or of both."""
    found = sorted((bench.folder / "cache" / "beamdae").glob("*.o"))
    if loops is not None:
        found = [path for path in found if path.name.split("-")[0].endswith("_steps") is loops]
    expect(bool(found), "nothing was cached")
    return found


def _fill(bench: Bench) -> None:
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "cache")
    tables = {}
    for switch in ("off", "on"):
        bench.env["BEAMDAE_NATIVE"] = switch
        bench.simulated(*_RUN, limit=_LIMIT)
        tables[switch] = pd.read_csv(bench.folder / "results" / "arm.csv")
        bench.write(f"{switch}.csv", bench.rows)
    difference = (tables["on"] - tables["off"]).abs().max()
    size = tables["off"].abs().max()
    expect(bool(np.all(difference <= 1e-8 * (1.0 + size))), "machine code gives other results")


def _filled(bench: Bench) -> None:
    """Tables of plain Python and of machine code, and a cache with the objects for it."""
    prepared(bench, _fill)
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "cache")
    bench.env.pop("BEAMDAE_NATIVE", None)


def _right(bench: Bench, ran: Ran, sentences: int, switch: str = "on") -> None:
    """It ended well, with so many sentences, and the table of machine code or of plain Python."""
    told(ran, 0)
    expect(bench.rows == (bench.folder / f"{switch}.csv").read_text(), "the results are others")
    said = ran.err.count("BEAMDAE_NATIVE=off")
    expect(said == sentences, f"{said} sentences: {ran.last}")


def _right_after(bench: Bench, sentences: int = 0, switch: str = "on") -> None:
    _right(bench, bench.simulated(*_RUN, limit=_LIMIT), sentences, switch)


def _mended(bench: Bench, files: list[Path]) -> None:
    """What is damaged is built again, once, and the results are right."""
    damaged = {path: _content(path) for path in files}
    _right_after(bench)
    for path, content in damaged.items():
        expect(_content(path) != content, f"{path.name} is still damaged")
    before = {path: path.stat().st_mtime_ns for path in _objects(bench)}
    _right_after(bench)
    after = {path: path.stat().st_mtime_ns for path in _objects(bench)}
    expect(after == before, "objects are built again and again")


def _content(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None


def _damaged(bench: Bench, loops: bool | None, content: Callable[[Path], bytes]) -> None:
    """Loops or kernels, or both, are mended that have been given other contents."""
    _filled(bench)
    files = _objects(bench, loops)
    for path in files:
        path.write_bytes(content(path))
    _mended(bench, files)


def truncated_kernels(bench: Bench) -> None:
    """Kernels of which half is missing are built again."""
    _damaged(bench, False, lambda path: path.read_bytes()[: path.stat().st_size // 2])


def kernels_of_random_bytes(bench: Bench) -> None:
    """Kernels that are none are built again."""
    _damaged(bench, False, lambda path: os.urandom(5000))


def another_functions_kernel(bench: Bench) -> None:
    """A kernel by the name of another one is not used."""
    _filled(bench)
    files = _objects(bench, loops=False)
    kept = [path.read_bytes() for path in files]
    for path, other in zip(files, kept[1:] + kept[:1], strict=True):
        path.write_bytes(other)
    _mended(bench, files)


def truncated_loop(bench: Bench) -> None:
    """A loop of which some is missing is compiled again."""
    _damaged(bench, True, lambda path: path.read_bytes()[:-1000])


def another_loop_of_the_same_size(bench: Bench) -> None:
    """A valid loop that does something else, of the same size, is not used."""
    _damaged(bench, True, lambda path: _false(path).ljust(path.stat().st_size, b"\0"))


def text_for_a_loop(bench: Bench) -> None:
    """A text in the place of a loop is not used."""
    _damaged(bench, True, lambda path: b"def loop(work):\n    return 0\n")


def empty_objects(bench: Bench) -> None:
    """Empty files in the place of kernels and loops are built again."""
    _damaged(bench, None, lambda path: b"")


def _false(path: Path) -> bytes:
    """A valid object with the same symbols."""
    return compile_module(_FALSE.format(name=path.name.split("-")[0]), 0)


def _falsified(bench: Bench) -> None:
    _filled(bench)
    for path in _objects(bench):
        path.write_bytes(_false(path))


def false_objects(bench: Bench) -> None:
    """Valid objects that compute something else are not used."""
    _falsified(bench)
    _right_after(bench)


def cache_others_may_write(bench: Bench) -> None:
    """Objects in a folder that others may write are not trusted."""
    _falsified(bench)
    (bench.folder / "cache" / "beamdae").chmod(0o777)
    _right_after(bench)


def cache_of_another_user(bench: Bench) -> None:
    """Objects in another user's folder are not trusted."""
    if os.geteuid() != 0:
        raise NotPossibleError("only root may give a folder away")
    _falsified(bench)
    for path in [bench.folder / "cache" / "beamdae", *_objects(bench)]:
        os.chown(path, 65534, 65534)
    _right_after(bench, sentences=1)


def new_cache_is_private(bench: Bench) -> None:
    """A folder made for the cache is for its user alone, whatever the mask."""
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "cache")
    line = f"umask 0; BEAMDAE run model.py --no-estimate {' '.join(_RUN)}"
    told(bench.shell(line, limit=_LIMIT), 0)
    mode = (bench.folder / "cache" / "beamdae").stat().st_mode & 0o777
    expect(mode == 0o700, f"its mode is {mode:o}")


def folders_for_objects(bench: Bench) -> None:
    """Folders by the names of objects are replaced."""
    _filled(bench)
    for path in (files := _objects(bench, loops=False)):
        path.unlink()
        path.mkdir()
    _mended(bench, files)


def relative_cache(bench: Bench) -> None:
    """A relative XDG_CACHE_HOME is not a place, as its specification says."""
    _filled(bench)
    bench.env |= {"XDG_CACHE_HOME": "relative", "HOME": str(bench.folder / "home")}
    _right_after(bench)
    expect(not (bench.folder / "relative").exists(), "a cache was made where the command ran")


def cache_in_a_file(bench: Bench) -> None:
    """A cache that cannot be a folder is done without."""
    _filled(bench)
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "model.py")
    _right_after(bench, sentences=1)


def read_only_cache(bench: Bench) -> None:
    """A cache that cannot be written is done without."""
    _filled(bench)
    locked = bench.folder / "locked"
    locked.mkdir()
    locked.chmod(0o555)
    bench.env["XDG_CACHE_HOME"] = str(locked)
    command = bench.command("run", "model.py", "--no-estimate", *_RUN)
    _right(bench, bench.finish(bench.start(unprivileged(bench, command)), _LIMIT), sentences=1)


def full_disk_of_the_cache(bench: Bench) -> None:
    """A cache without room is done without, and nothing half written stays."""
    _filled(bench)
    with small_disk(disk := bench.folder / "disk", 8):
        bench.env["XDG_CACHE_HOME"] = str(disk)
        _right_after(bench, sentences=1)
        expect(not list(disk.glob("beamdae/build-*")), "scratch files stay in the cache")


def two_at_once(bench: Bench) -> None:
    """Two runs that begin with one empty cache both succeed."""
    _filled(bench)
    shutil.rmtree(bench.folder / "cache")
    command = bench.command("run", "model.py", "--no-estimate", *_RUN, "--out")
    both = [bench.start([*command, f"out {k}"]) for k in range(2)]
    for ran in [bench.finish(one, _LIMIT) for one in both]:
        told(ran, 0)
    for k in range(2):
        rows = (bench.folder / f"out {k}" / "arm.csv").read_text()
        expect(rows == (bench.folder / "on.csv").read_text(), "the results are others")


def unknown_switch(bench: Bench) -> None:
    """BEAMDAE_NATIVE of anything but "off" is as without it."""
    _filled(bench)
    bench.env["BEAMDAE_NATIVE"] = "perhaps"
    _right_after(bench)


def _without(bench: Bench, package: str, cache: str) -> None:
    """A package that cannot be imported, for runs with this cache."""
    _filled(bench)
    (shadow := bench.folder / "shadow").mkdir()
    (shadow / f"{package}.py").write_text("raise ImportError('it is broken')\n")
    bench.env["PYTHONPATH"] = os.pathsep.join([str(shadow), str(ROOT)])
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / cache)


def no_numba(bench: Bench) -> None:
    """Without numba runs go on in plain Python, and one sentence says so."""
    _without(bench, "numba", "empty cache")
    _right_after(bench, sentences=1, switch="off")


def no_numba_but_a_cache(bench: Bench) -> None:
    """What was compiled before needs no numba."""
    _without(bench, "numba", "cache")
    _right_after(bench)


def no_llvmlite(bench: Bench) -> None:
    """Without llvmlite runs go on in plain Python, and one sentence says so."""
    _without(bench, "llvmlite", "cache")
    _right_after(bench, sentences=1, switch="off")


FAULTS = (
    truncated_kernels,
    kernels_of_random_bytes,
    another_functions_kernel,
    another_loop_of_the_same_size,
    false_objects,
    cache_others_may_write,
    cache_of_another_user,
    new_cache_is_private,
    folders_for_objects,
    relative_cache,
    read_only_cache,
    full_disk_of_the_cache,
    two_at_once,
    unknown_switch,
    no_numba,
    no_numba_but_a_cache,
    no_llvmlite,
)
# As those above, at the cost of one more loop to be compiled each.
SLOW = (truncated_loop, text_for_a_loop, empty_objects, cache_in_a_file)
