"""Faults of a run: interrupts, signals, limits of time and memory, poor environments."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time

from robustness.bench import (
    LONG,
    MODEL,
    Bench,
    Ran,
    expect,
    no_traceback,
    told,
    unprivileged,
)

RUN = ("run", "model.py", "--output-step", "1")


# After so many seconds it is under way.
_STARTED = 2.0


def _signaled(bench: Bench, number: int, seconds: float, times: int = 1) -> Ran:
    """A long run that is sent a signal after so many seconds.

    What it compiles is compiled before: signals wait for the compiler, and are for the run.
    """
    if seconds > _STARTED:
        bench.simulated()
    bench.write("model.py", LONG)
    # Of fewer elements it takes a million steps in this time, and seconds to sum them up.
    process = bench.start(bench.command(*RUN, "--set", "elements=16"))
    time.sleep(seconds)
    for _ in range(times):
        if process.poll() is None:
            os.killpg(process.pid, number)
            time.sleep(0.3)
    return no_traceback(bench.finish(process, 30.0))


def _kept(bench: Bench, kind: str) -> None:
    expect(len(bench.rows.splitlines()) > 1, "no row was kept")
    beside = json.loads((bench.folder / "results" / "arm.json").read_text())
    expect(beside["result"]["status"] == kind, f"the status is {beside['result']['status']}")


def interrupt_at_once(bench: Bench) -> None:
    """Ctrl-C while modules are imported is no traceback."""
    for seconds in (0.1, 0.3, 0.5, 0.7, 0.9):
        ran = _signaled(bench, signal.SIGINT, seconds)
        expect(ran.code in (130, -signal.SIGINT), f"exit code {ran.code}, {ran.last}")


def interrupt_in_the_run(bench: Bench) -> None:
    """Ctrl-C keeps what was computed, and the exit code is 130."""
    ran = _signaled(bench, signal.SIGINT, 5.0)
    expect(ran.code == 130, f"exit code {ran.code}, {ran.last}")
    _kept(bench, "interrupted")


def interrupt_in_the_estimate(bench: Bench) -> None:
    """Ctrl-C in the second run keeps the first one."""
    bench.write("model.py", MODEL.replace("t_end=0.02", "t_end=20.0"))
    process = bench.start(bench.command("run", "model.py"))
    table = bench.folder / "results" / "arm.csv"
    end = time.perf_counter() + 60.0
    while not table.exists() and process.poll() is None and time.perf_counter() < end:
        time.sleep(0.02)
    time.sleep(0.2)
    expect(process.poll() is None, "the second run was over too soon")
    os.killpg(process.pid, signal.SIGINT)
    ran = no_traceback(bench.finish(process, 30.0))
    expect(ran.code == 130, f"exit code {ran.code}, {ran.last}")
    _kept(bench, "ok")


def interrupt_twice(bench: Bench) -> None:
    """Ctrl-C again and again is no traceback."""
    ran = _signaled(bench, signal.SIGINT, 5.0, times=4)
    expect(ran.code in (130, -signal.SIGINT), f"exit code {ran.code}, {ran.last}")


def terminated(bench: Bench) -> None:
    """SIGTERM ends a run at once."""
    # What was computed is summed up, which takes a small part of the time it took.
    ran = _signaled(bench, signal.SIGTERM, 2.5)
    expect(ran.code in (143, -signal.SIGTERM), f"exit code {ran.code}, {ran.last}")
    expect(ran.seconds < 5.0, f"after {ran.seconds:.1f} s")


def time_limit(bench: Bench) -> None:
    """--time-limit ends a run with its reason, and keeps what was computed."""
    bench.write("model.py", LONG)
    ran = told(bench.run(*RUN, "--time-limit", "2", limit=30.0), 1)
    expect("time limit" in ran.err, f"no word of the limit: {ran.last}")
    _kept(bench, "limited")


def time_limit_of_a_build(bench: Bench) -> None:
    """--time-limit is not forgotten where the equations alone take longer."""
    arguments = ("run", "model.py", "--set", "elements=200000", "--time-limit", "2")
    told(bench.run(*arguments, limit=60.0), 1, 2)


def time_limit_of_each_method(bench: Bench) -> None:
    """--time-limit holds for each integrator."""
    bench.write("model.py", LONG)
    for method in ("ida", "radau", "generalized-alpha"):
        more = ("--integrator", method, "--time-limit", "1", "--no-estimate")
        ran = told(bench.run(*RUN, *more, limit=30.0), 1)
        expect("time limit" in ran.err, f"{method}: no word of the limit: {ran.last}")


def _limited(bench: Bench, arguments: str, gigabytes: float, limit: float = 60.0) -> Ran:
    kilobytes = int(gigabytes * 1e6)
    return bench.shell(f"ulimit -v {kilobytes}; BEAMDAE {arguments}", limit=limit)


def memory_in_the_model(bench: Bench) -> None:
    """A model that asks for more memory than there is, is told in a sentence."""
    bench.write("model.py", MODEL.replace("# more", "np.ones(10**10)"))
    told(_limited(bench, "run model.py", 4.0), 1, 2)


def memory_in_the_run(bench: Bench) -> None:
    """Rows that do not fit in memory are told in a sentence."""
    more = "--integrator generalized-alpha --step 1e-8 --output-step 2e-9 --t-end 0.02"
    told(_limited(bench, f"run model.py {more} --no-estimate --time-limit 20", 2.0), 0, 1, 2)


def ten_million_elements(bench: Bench) -> None:
    """A mesh that cannot be computed is told in a sentence, soon."""
    ran = _limited(bench, "run model.py --set elements=10000000 --no-estimate", 4.0, limit=60.0)
    told(ran, 1, 2)


def ten_thousand_elements(bench: Bench) -> None:
    """Ida on 10 000 elements in 4 GB ends with a result or a sentence."""
    more = "--set elements=10000 --integrator ida --no-estimate --t-end 1e-4 --time-limit 60"
    told(_limited(bench, f"run model.py {more}", 4.0, limit=240.0), 0, 1, 2)


def plain_locale(bench: Bench) -> None:
    """The locale C takes names in other letters."""
    bench.env |= {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    bench.write("model.py", MODEL.replace('label="tip"', 'label="\\u03b8"'))
    bench.simulated()
    expect("\u03b8" in (bench.folder / "results/arm.csv").read_text("utf-8"), "the name is lost")


def plain_output(bench: Bench) -> None:
    """A terminal of ASCII alone takes what it can."""
    bench.env["PYTHONIOENCODING"] = "ascii"
    bench.write("model.py", MODEL.replace('label="tip"', 'label="\\u03b8"'))
    bench.simulated()


def plain_output_of_a_list(bench: Bench) -> None:
    """`beamdae list` on a terminal of ASCII alone."""
    bench.env["PYTHONIOENCODING"] = "ascii"
    bench.write("model.py", MODEL.replace('label="tip"', 'label="\\u03b8"'))
    told(bench.run("list", "model.py"), 0)


def plain_errors(bench: Bench) -> None:
    """A mistake with other letters in its name on a terminal of ASCII alone."""
    bench.env["PYTHONIOENCODING"] = "ascii"
    told(bench.run("run", "model.py", "--set", "\u03b8=1"), 2)


def narrow_terminal(bench: Bench) -> None:
    """A terminal of one column."""
    bench.env |= {"COLUMNS": "1", "LINES": "1", "TERM": "dumb"}
    bench.simulated()


def no_home(bench: Bench) -> None:
    """No HOME in the environment, nor a cache."""
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        bench.env.pop(name, None)
    bench.simulated()


def home_nowhere(bench: Bench) -> None:
    """A HOME that does not exist and cannot be made."""
    bench.env |= {"HOME": "/proc/nowhere"}
    bench.env.pop("XDG_CACHE_HOME", None)
    bench.simulated()


def read_only_home(bench: Bench) -> None:
    """A HOME that cannot be written."""
    home = bench.folder / "home"
    home.mkdir()
    home.chmod(0o555)
    bench.env |= {"HOME": str(home)}
    bench.env.pop("XDG_CACHE_HOME", None)
    command = bench.command("run", "model.py", "--no-estimate")
    told(bench.finish(bench.start(unprivileged(bench, command))), 0)


def no_scratch_folder(bench: Bench) -> None:
    """A TMPDIR that does not exist."""
    bench.env |= {"TMPDIR": "/proc/nowhere"}
    bench.simulated()


def folder_deleted(bench: Bench) -> None:
    """A folder that is deleted while the command runs in it is told in a sentence."""
    line = f"mkdir gone; cd gone; rmdir ../gone; BEAMDAE run {bench.folder}/model.py --no-estimate"
    told(bench.shell(line), 1, 2)


def results_deleted(bench: Bench) -> None:
    """A results folder that is deleted during the run is made again."""
    bench.write("model.py", LONG)
    (bench.folder / "results").mkdir()
    settings = ("--integrator", "ida", "--t-end", "1000", "--no-estimate")
    process = bench.start(bench.command(*RUN, *settings))
    # Long before it has something to write.
    time.sleep(2.0)
    shutil.rmtree(bench.folder / "results")
    told(bench.finish(process), 0)


def two_in_one_folder(bench: Bench) -> None:
    """Two runs into one folder leave whole files."""
    command = bench.command("run", "model.py", "--no-estimate")
    both = [bench.start(command) for _ in range(2)]
    for ran in [bench.finish(one) for one in both]:
        told(ran, 0)
    json.loads((bench.folder / "results" / "arm.json").read_text())
    expect(bench.rows.count("\n") == 1002, "the table is not whole")


FAULTS = (
    interrupt_at_once,
    interrupt_in_the_run,
    interrupt_in_the_estimate,
    interrupt_twice,
    terminated,
    time_limit,
    time_limit_of_each_method,
    memory_in_the_model,
    memory_in_the_run,
    plain_locale,
    plain_output,
    plain_output_of_a_list,
    plain_errors,
    narrow_terminal,
    no_home,
    home_nowhere,
    read_only_home,
    no_scratch_folder,
    folder_deleted,
    results_deleted,
    two_in_one_folder,
)
SLOW = (ten_million_elements, ten_thousand_elements, time_limit_of_a_build)
