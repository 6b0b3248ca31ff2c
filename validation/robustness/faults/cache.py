"""Faults of the machine code cache and of the compiler; results must stay correct."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from beamdae.native.llvm import compile_module
from robustness.faults.bench import (
    ROOT,
    Bench,
    CommandResult,
    UnsupportedMachineError,
    copy_prepared,
    drop_privileges,
    expect,
    expect_exit,
    mount_small_disk,
)

# Fixed steps in a compiled loop, so that the steps do not depend on rounding.
_RUN_OPTIONS = ("--integrator", "generalized-alpha")
_COMPILE_TIME_LIMIT = 150.0  # s; compilation on a loaded machine
_TABLE_TOLERANCE = 1e-8  # of compiled results, relative to 1 plus the largest value
_NOBODY = 65534  # user and group id
_WRONG_MODULE = """
define void @{name}(ptr %shared, ptr %local, ptr %out, i64 %padded) {{
  store double 0.5, ptr %out
  ret void
}}
define i32 @loop(ptr %table) {{ ret i32 0 }}
"""


def _list_objects(bench: Bench, loops: bool | None = None) -> list[Path]:
    """Return files of the cache: of the core with its loops, of kernels, or of both."""
    paths = sorted((bench.folder / "cache" / "beamdae").glob("*.o"))
    if loops is not None:
        paths = [path for path in paths if (path.name.split("-")[0] == "core") is loops]
    expect(bool(paths), "nothing was cached")
    return paths


def _fill_cache(bench: Bench) -> None:
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "cache")
    tables = {}
    for switch in ("off", "on"):
        bench.env["BEAMDAE_NATIVE"] = switch
        bench.run_model(*_RUN_OPTIONS, time_limit=_COMPILE_TIME_LIMIT)
        tables[switch] = pd.read_csv(bench.folder / "results" / "arm.csv")
        bench.write(f"{switch}.csv", bench.table_text)
    difference = (tables["on"] - tables["off"]).abs().max()
    size = tables["off"].abs().max()
    expect(
        bool(np.all(difference <= _TABLE_TOLERANCE * (1.0 + size))),
        "results of machine code differ",
    )


def _use_filled_cache(bench: Bench) -> None:
    """Copy tables of both modes and a cache with all objects into the bench."""
    copy_prepared(bench, _fill_cache)
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "cache")
    bench.env.pop("BEAMDAE_NATIVE", None)


def _expect_results(bench: Bench, result: CommandResult, warnings: int, switch: str = "on") -> None:
    """Check the exit code, the number of warnings, and the table of the mode `switch`."""
    expect_exit(result, 0)
    expect(bench.table_text == (bench.folder / f"{switch}.csv").read_text(), "the results differ")
    count = result.err.count("BEAMDAE_NATIVE=off")
    expect(count == warnings, f"{count} warnings: {result.error_tail}")


def _expect_correct_run(bench: Bench, warnings: int = 0, switch: str = "on") -> None:
    result = bench.run_model(*_RUN_OPTIONS, time_limit=_COMPILE_TIME_LIMIT)
    _expect_results(bench, result, warnings, switch)


def _expect_rebuilt(bench: Bench, files: list[Path]) -> None:
    """Check that damaged objects are rebuilt once, and that results are correct."""
    damaged_content = {path: _read_file(path) for path in files}
    _expect_correct_run(bench)
    for path, content in damaged_content.items():
        expect(_read_file(path) != content, f"{path.name} is still damaged")
    before = {path: path.stat().st_mtime_ns for path in _list_objects(bench)}
    _expect_correct_run(bench)
    after = {path: path.stat().st_mtime_ns for path in _list_objects(bench)}
    expect(after == before, "objects are rebuilt in every run")


def _read_file(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None


def _damage_objects(bench: Bench, loops: bool | None, content: Callable[[Path], bytes]) -> None:
    """Replace the contents of loops, kernels or both, and check that they are rebuilt."""
    _use_filled_cache(bench)
    files = _list_objects(bench, loops)
    for path in files:
        path.write_bytes(content(path))
    _expect_rebuilt(bench, files)


def truncated_kernels(bench: Bench) -> None:
    """Kernels cut in half are rebuilt."""
    _damage_objects(bench, False, lambda path: path.read_bytes()[: path.stat().st_size // 2])


def kernels_of_random_bytes(bench: Bench) -> None:
    """Kernels of random bytes are rebuilt."""
    _damage_objects(bench, False, lambda path: os.urandom(5000))


def swapped_kernels(bench: Bench) -> None:
    """A kernel under the name of another one is not used."""
    _use_filled_cache(bench)
    files = _list_objects(bench, loops=False)
    contents = [path.read_bytes() for path in files]
    for path, content in zip(files, contents[1:] + contents[:1], strict=True):
        path.write_bytes(content)
    _expect_rebuilt(bench, files)


def truncated_loop(bench: Bench) -> None:
    """A truncated loop is recompiled."""
    _damage_objects(bench, True, lambda path: path.read_bytes()[:-1000])


def another_loop_of_the_same_size(bench: Bench) -> None:
    """A valid loop of the same size that computes something else is not used."""
    _damage_objects(bench, True, lambda path: _wrong_object(path).ljust(path.stat().st_size, b"\0"))


def text_as_a_loop(bench: Bench) -> None:
    """A text file in place of a loop is not used."""
    _damage_objects(bench, True, lambda path: b"def loop(work):\n    return 0\n")


def empty_objects(bench: Bench) -> None:
    """Empty files in place of kernels and loops are rebuilt."""
    _damage_objects(bench, None, lambda path: b"")


def _wrong_object(path: Path) -> bytes:
    """Return a valid object with the same symbols that computes something else."""
    return compile_module(_WRONG_MODULE.format(name=path.name.split("-")[0]), 0)


def _use_wrong_objects(bench: Bench) -> None:
    _use_filled_cache(bench)
    for path in _list_objects(bench):
        path.write_bytes(_wrong_object(path))


def objects_of_other_functions(bench: Bench) -> None:
    """Valid objects that compute something else are not used."""
    _use_wrong_objects(bench)
    _expect_correct_run(bench)


def cache_writable_by_others(bench: Bench) -> None:
    """Objects in a folder that other users may write are not trusted."""
    _use_wrong_objects(bench)
    (bench.folder / "cache" / "beamdae").chmod(0o777)
    _expect_correct_run(bench)


def cache_of_another_user(bench: Bench) -> None:
    """Objects in another user's folder are not trusted."""
    if os.geteuid() != 0:
        raise UnsupportedMachineError("only root may change the owner of a folder")
    _use_wrong_objects(bench)
    for path in [bench.folder / "cache" / "beamdae", *_list_objects(bench)]:
        os.chown(path, _NOBODY, _NOBODY)
    _expect_correct_run(bench, warnings=1)


def new_cache_is_private(bench: Bench) -> None:
    """A new cache folder is accessible to its user alone, whatever the umask."""
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "cache")
    line = f"umask 0; BEAMDAE run model.py --no-estimate {' '.join(_RUN_OPTIONS)}"
    expect_exit(bench.run_in_shell(line, time_limit=_COMPILE_TIME_LIMIT), 0)
    mode = (bench.folder / "cache" / "beamdae").stat().st_mode & 0o777
    expect(mode == 0o700, f"its mode is {mode:o}")


def folders_as_objects(bench: Bench) -> None:
    """Folders with the names of objects are replaced."""
    _use_filled_cache(bench)
    for path in (files := _list_objects(bench, loops=False)):
        path.unlink()
        path.mkdir()
    _expect_rebuilt(bench, files)


def relative_cache(bench: Bench) -> None:
    """A relative XDG_CACHE_HOME is ignored, as its specification requires."""
    _use_filled_cache(bench)
    bench.env |= {"XDG_CACHE_HOME": "relative", "HOME": str(bench.folder / "home")}
    _expect_correct_run(bench)
    expect(not (bench.folder / "relative").exists(), "a cache was created in the working folder")


def cache_inside_a_file(bench: Bench) -> None:
    """Without a possible cache folder the run succeeds with one warning."""
    _use_filled_cache(bench)
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / "model.py")
    _expect_correct_run(bench, warnings=1)


def read_only_cache(bench: Bench) -> None:
    """With a read-only cache folder the run succeeds with one warning."""
    _use_filled_cache(bench)
    locked = bench.folder / "locked"
    locked.mkdir()
    locked.chmod(0o555)
    bench.env["XDG_CACHE_HOME"] = str(locked)
    command = bench.command("run", "model.py", "--no-estimate", *_RUN_OPTIONS)
    _expect_results(
        bench,
        bench.finish(bench.start(drop_privileges(command)), _COMPILE_TIME_LIMIT),
        warnings=1,
    )


def full_disk_for_the_cache(bench: Bench) -> None:
    """With a full disk the run succeeds, and no scratch files remain in the cache."""
    _use_filled_cache(bench)
    with mount_small_disk(disk := bench.folder / "disk", 8):
        bench.env["XDG_CACHE_HOME"] = str(disk)
        _expect_correct_run(bench, warnings=1)
        expect(not list(disk.glob("beamdae/build-*")), "scratch files stay in the cache")


def two_runs_with_an_empty_cache(bench: Bench) -> None:
    """Two runs that start with the same empty cache both succeed."""
    _use_filled_cache(bench)
    shutil.rmtree(bench.folder / "cache")
    command = bench.command("run", "model.py", "--no-estimate", *_RUN_OPTIONS, "--out")
    processes = [bench.start([*command, f"out {k}"]) for k in range(2)]
    for result in [bench.finish(process, _COMPILE_TIME_LIMIT) for process in processes]:
        expect_exit(result, 0)
    for k in range(2):
        rows = (bench.folder / f"out {k}" / "arm.csv").read_text()
        expect(rows == (bench.folder / "on.csv").read_text(), "the results differ")


def unknown_switch(bench: Bench) -> None:
    """Any value of BEAMDAE_NATIVE but "off" has no effect."""
    _use_filled_cache(bench)
    bench.env["BEAMDAE_NATIVE"] = "perhaps"
    _expect_correct_run(bench)


def _hide_package(bench: Bench, package: str, cache: str) -> None:
    """Make the import of a package fail, for runs with this cache."""
    _use_filled_cache(bench)
    (shadow := bench.folder / "shadow").mkdir()
    (shadow / f"{package}.py").write_text("raise ImportError('it is broken')\n")
    bench.env["PYTHONPATH"] = os.pathsep.join([str(shadow), str(ROOT)])
    bench.env["XDG_CACHE_HOME"] = str(bench.folder / cache)


def missing_llvmlite(bench: Bench) -> None:
    """Without llvmlite, CasADi's virtual machine runs the kernels, with one warning."""
    _hide_package(bench, "llvmlite", "cache")
    _expect_correct_run(bench, warnings=1, switch="off")


FAULTS = (
    truncated_kernels,
    kernels_of_random_bytes,
    swapped_kernels,
    another_loop_of_the_same_size,
    objects_of_other_functions,
    cache_writable_by_others,
    cache_of_another_user,
    new_cache_is_private,
    folders_as_objects,
    relative_cache,
    read_only_cache,
    full_disk_for_the_cache,
    two_runs_with_an_empty_cache,
    unknown_switch,
    missing_llvmlite,
)
# Similar to the faults above, but each compiles one more loop.
SLOW = (truncated_loop, text_as_a_loop, empty_objects, cache_inside_a_file)
