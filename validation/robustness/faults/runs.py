"""Faults of a run: interrupts, signals, limits of time and memory, environments."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time

from robustness.faults.bench import (
    LONG_MODEL,
    MODEL,
    Bench,
    CommandResult,
    drop_privileges,
    expect,
    expect_code,
    expect_exit,
    expect_no_traceback,
)
from robustness.judge import EXIT_INTERRUPTED

RUN = ("run", "model.py", "--output-step", "1")

_START_TIME = 2.0  # s; later signals arrive during the run
_TABLE_LINES = 1002  # of a complete run: header and 1001 rows
# End times [s] of runs of LONG_MODEL that take 4 s or more. Ida takes steps of 1e-5 s and Radau of
# 1e-4 to 4e-4 s; longer runs would count as stalled.
_LONG_END_TIMES = {"ida": "50", "radau": "100", "generalized-alpha": "2000"}

# End time [s] of the run of 16 elements by the default integrator, which takes about half a minute.
# That of LONG_MODEL would count as stalled after 12 800 steps, about 5 s.
_LONG_END_TIME = "100"


def _send_signal(bench: Bench, number: int, seconds: float, repetitions: int = 1) -> CommandResult:
    """Return the result of a long run that gets a signal after so many seconds.

    All machine code is compiled beforehand, because signals wait for the compiler.
    """
    if seconds > _START_TIME:
        bench.run_model()
    bench.write("model.py", LONG_MODEL)
    # With fewer elements, the run would take a million steps, and their summary several seconds.
    more = ("--set", "elements=16", "--t-end", _LONG_END_TIME)
    process = bench.start(bench.command(*RUN, *more))
    time.sleep(seconds)
    for _ in range(repetitions):
        if process.poll() is None:
            os.killpg(process.pid, number)
            time.sleep(0.3)
    return expect_no_traceback(bench.finish(process, 30.0))


def _expect_rows_kept(bench: Bench, kind: str) -> None:
    expect(len(bench.table_text.splitlines()) > 1, "no row was kept")
    record = json.loads((bench.folder / "results" / "arm.json").read_text())
    status = record["result"]["status"]
    expect(status == kind, f"the status is {status}")


def interrupt_during_import(bench: Bench) -> None:
    """Ctrl-C during imports shows no traceback."""
    # Until the package is imported, Python handles signals.
    start = bench.finish(bench.start([sys.executable, "-c", "import beamdae"])).seconds
    for seconds in (0.1, 0.3, 0.5, 0.7, 0.9):
        result = _send_signal(bench, signal.SIGINT, start + seconds)
        expect_code(result, EXIT_INTERRUPTED, -signal.SIGINT)


def interrupt_during_the_run(bench: Bench) -> None:
    """Ctrl-C keeps computed rows, and the exit code is 130."""
    result = _send_signal(bench, signal.SIGINT, 5.0)
    expect_code(result, EXIT_INTERRUPTED)
    _expect_rows_kept(bench, "interrupted")


def interrupt_during_the_estimate(bench: Bench) -> None:
    """Ctrl-C in the second run keeps the rows of the first one."""
    bench.write("model.py", MODEL.replace("t_end=0.02", "t_end=20.0"))
    process = bench.start(bench.command("run", "model.py"))
    table = bench.folder / "results" / "arm.csv"
    end = time.perf_counter() + 60.0
    while not table.exists() and process.poll() is None and time.perf_counter() < end:
        time.sleep(0.02)
    time.sleep(0.2)
    expect(process.poll() is None, "the second run was over too soon")
    os.killpg(process.pid, signal.SIGINT)
    result = expect_no_traceback(bench.finish(process, 30.0))
    expect_code(result, EXIT_INTERRUPTED)
    _expect_rows_kept(bench, "ok")


def interrupt_twice(bench: Bench) -> None:
    """Ctrl-C repeated shows no traceback."""
    result = _send_signal(bench, signal.SIGINT, 5.0, repetitions=4)
    expect_code(result, EXIT_INTERRUPTED, -signal.SIGINT)


def termination_signal(bench: Bench) -> None:
    """SIGTERM ends a run immediately."""
    # Summarizing the computed rows takes a small part of the run time.
    result = _send_signal(bench, signal.SIGTERM, 2.5)
    expect_code(result, 128 + signal.SIGTERM, -signal.SIGTERM)
    expect(result.seconds < 5.0, f"after {result.seconds:.1f} s")


def time_limit(bench: Bench) -> None:
    """--time-limit ends a run with that reason, and keeps computed rows."""
    bench.write("model.py", LONG_MODEL)
    more = ("--set", "elements=16", "--t-end", _LONG_END_TIME, "--time-limit", "2")
    result = expect_exit(bench.run(*RUN, *more, time_limit=30.0), 1)
    expect("time limit" in result.err, f"no message about the limit: {result.error_tail}")
    _expect_rows_kept(bench, "limited")


def time_limit_of_a_build(bench: Bench) -> None:
    """--time-limit also applies to a run whose equations alone take longer to build."""
    arguments = ("run", "model.py", "--set", "elements=200000", "--time-limit", "2")
    expect_exit(bench.run(*arguments, time_limit=60.0), 1, 2)


def time_limit_of_each_method(bench: Bench) -> None:
    """--time-limit applies to each integrator."""
    bench.write("model.py", LONG_MODEL)
    for method, t_end in _LONG_END_TIMES.items():
        more = ("--integrator", method, "--t-end", t_end, "--time-limit", "1", "--no-estimate")
        result = expect_exit(bench.run(*RUN, *more, time_limit=30.0), 1)
        expect(
            "time limit" in result.err, f"{method}: no message about the limit: {result.error_tail}"
        )


def _run_in_memory(
    bench: Bench, arguments: str, gigabytes: float, time_limit: float = 60.0
) -> CommandResult:
    kilobytes = int(gigabytes * 1e6)
    return bench.run_in_shell(f"ulimit -v {kilobytes}; BEAMDAE {arguments}", time_limit=time_limit)


def memory_limit_in_the_model(bench: Bench) -> None:
    """A model that allocates more memory than available is reported."""
    bench.write("model.py", MODEL.replace("# more", "np.ones(10**10)"))
    expect_exit(_run_in_memory(bench, "run model.py", 4.0), 1, 2)


def memory_limit_in_the_run(bench: Bench) -> None:
    """Rows that do not fit in memory are reported."""
    more = "--integrator generalized-alpha --step 1e-8 --output-step 2e-9 --t-end 0.02"
    expect_exit(
        _run_in_memory(bench, f"run model.py {more} --no-estimate --time-limit 20", 2.0), 0, 1, 2
    )


def ten_million_elements(bench: Bench) -> None:
    """A mesh that is too large is reported within a minute."""
    result = _run_in_memory(
        bench, "run model.py --set elements=10000000 --no-estimate", 4.0, time_limit=60.0
    )
    expect_exit(result, 1, 2)


def ten_thousand_elements(bench: Bench) -> None:
    """Ida on 10 000 elements in 4 GB ends with a result or a message."""
    more = "--set elements=10000 --integrator ida --no-estimate --t-end 1e-4 --time-limit 60"
    expect_exit(_run_in_memory(bench, f"run model.py {more}", 4.0, time_limit=240.0), 0, 1, 2)


def c_locale(bench: Bench) -> None:
    """Names with other letters work in the locale C."""
    bench.env |= {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    bench.write("model.py", MODEL.replace('label="tip"', 'label="\\u03b8"'))
    bench.run_model()
    expect("\u03b8" in (bench.folder / "results/arm.csv").read_text("utf-8"), "the name is lost")


def ascii_output(bench: Bench) -> None:
    """Names with other letters work on an ASCII terminal."""
    bench.env["PYTHONIOENCODING"] = "ascii"
    bench.write("model.py", MODEL.replace('label="tip"', 'label="\\u03b8"'))
    bench.run_model()


def ascii_output_of_a_list(bench: Bench) -> None:
    """`beamdae list` works on an ASCII terminal."""
    bench.env["PYTHONIOENCODING"] = "ascii"
    bench.write("model.py", MODEL.replace('label="tip"', 'label="\\u03b8"'))
    expect_exit(bench.run("list", "model.py"), 0)


def ascii_usage_error(bench: Bench) -> None:
    """A usage error with other letters is reported on an ASCII terminal."""
    bench.env["PYTHONIOENCODING"] = "ascii"
    expect_exit(bench.run("run", "model.py", "--set", "\u03b8=1"), 2)


def narrow_terminal(bench: Bench) -> None:
    """A run works in a terminal of one column."""
    bench.env |= {"COLUMNS": "1", "LINES": "1", "TERM": "dumb"}
    bench.run_model()


def missing_home(bench: Bench) -> None:
    """A run works without HOME and without a cache."""
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        bench.env.pop(name, None)
    bench.run_model()


def nonexistent_home(bench: Bench) -> None:
    """A run works with a HOME that does not exist and cannot be created."""
    bench.env |= {"HOME": "/proc/nowhere"}
    bench.env.pop("XDG_CACHE_HOME", None)
    bench.run_model()


def read_only_home(bench: Bench) -> None:
    """A run works with a read-only HOME."""
    home = bench.folder / "home"
    home.mkdir()
    home.chmod(0o555)
    bench.env |= {"HOME": str(home)}
    bench.env.pop("XDG_CACHE_HOME", None)
    command = bench.command("run", "model.py", "--no-estimate")
    expect_exit(bench.finish(bench.start(drop_privileges(command))), 0)


def nonexistent_tmpdir(bench: Bench) -> None:
    """A run works with a TMPDIR that does not exist."""
    bench.env |= {"TMPDIR": "/proc/nowhere"}
    bench.run_model()


def working_folder_deleted(bench: Bench) -> None:
    """A deleted working folder is reported."""
    line = f"mkdir gone; cd gone; rmdir ../gone; BEAMDAE run {bench.folder}/model.py --no-estimate"
    expect_exit(bench.run_in_shell(line), 1, 2)


def results_folder_deleted(bench: Bench) -> None:
    """A results folder that is deleted during the run is created again."""
    bench.write("model.py", LONG_MODEL)
    (bench.folder / "results").mkdir()
    settings = ("--integrator", "ida", "--t-end", "20", "--no-estimate")
    process = bench.start(bench.command(*RUN, *settings))
    # The rows are written at the end of the run, long after the deletion.
    time.sleep(2.0)
    shutil.rmtree(bench.folder / "results")
    expect_exit(bench.finish(process), 0)


def two_runs_in_one_folder(bench: Bench) -> None:
    """Two runs into one folder leave complete files."""
    command = bench.command("run", "model.py", "--no-estimate")
    processes = [bench.start(command) for _ in range(2)]
    for result in [bench.finish(process) for process in processes]:
        expect_exit(result, 0)
    json.loads((bench.folder / "results" / "arm.json").read_text())
    expect(bench.table_text.count("\n") == _TABLE_LINES, "the table is incomplete")


FAULTS = (
    interrupt_during_import,
    interrupt_during_the_run,
    interrupt_during_the_estimate,
    interrupt_twice,
    termination_signal,
    time_limit,
    time_limit_of_each_method,
    memory_limit_in_the_model,
    memory_limit_in_the_run,
    c_locale,
    ascii_output,
    ascii_output_of_a_list,
    ascii_usage_error,
    narrow_terminal,
    missing_home,
    nonexistent_home,
    read_only_home,
    nonexistent_tmpdir,
    working_folder_deleted,
    results_folder_deleted,
    two_runs_in_one_folder,
)
SLOW = (ten_million_elements, ten_thousand_elements, time_limit_of_a_build)
