"""Unusual surroundings: terminals, signals, NumPy settings, pools, limits, files and classes."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from mechanisms import free_ball

import beamdae as bd
from beamdae.symbolic.statements import Variable

ROOT = Path(bd.__file__).parents[1]
MODEL = '''
"""A ball."""
import numpy as np
import beamdae as bd
# above

@bd.model(t_end=0.05)
def ball(mass=1.0, value=None, kind="a", flag=False, number=1, pair=(1.0, 2.0)):
    # inside
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", mass, at=(0.0, 1.0)))
    mech.observe("ball", ball.point)
    return mech
'''


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def load(above="", inside=""):
    text = MODEL.replace("# above", above).replace("# inside", inside)
    Path("ball.py").write_text(text)
    return bd.load_model("ball.py")


def process(*arguments, **options):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen([sys.executable, *map(str, arguments)], env=environment, **options)


@pytest.mark.slow(reason="two runs and a page each")
@pytest.mark.parametrize(
    "over",
    [
        {"kind": ["a", "b"]},
        {"kind": ["b", "a", "c"]},
        {"flag": [False, True]},
        {"number": [1, 2]},
        {"mass": [1.0, 2.0]},
        {"mass": np.array([1.0, 2.0], np.float32)},
        {"pair": [(1.0, 2.0), (3.0, 4.0)]},
        {"value": [None, 1.0]},
        {"value": ["x", 1]},
        {"kind": ["a", "b"], "mass": [1.0, 2.0]},
        {"flag": [False, True], "number": [1, 2]},
    ],
    ids=str,
)
def test_sweeps_over_every_kind_of_parameter_have_a_page(over, folder):
    result = bd.sweep(load(), over, jobs=1)
    assert set(result.table["status"]) == {"ok"}
    assert result.page("page.html").stat().st_size > 0
    assert result.plot().save("plot.png").stat().st_size > 0


@pytest.mark.slow(reason="a run of some seconds")
@pytest.mark.parametrize("quiet", [[], ["-q"]], ids=str)
def test_a_closed_terminal_keeps_the_results(quiet, folder):
    pty = pytest.importorskip("pty")
    load(inside="open('built', 'w').close()")
    Path("built").unlink(missing_ok=True)
    master, terminal = pty.openpty()
    options = ["--integrator", "generalized-alpha", "--step", "1e-5", "--t-end", "1000", *quiet]
    command = process(
        *("-P", "-m", "beamdae", "run", "ball.py", *options),
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        start_new_session=True,
        preexec_fn=lambda: __import__("fcntl").ioctl(0, __import__("termios").TIOCSCTTY, 0),
    )
    os.close(terminal)
    reader = threading.Thread(target=_drain, args=(master, end := threading.Event()))
    reader.start()
    deadline = time.monotonic() + 60.0
    while not Path("built").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(1.0)  # The run takes minutes.
    end.set()
    reader.join()
    os.close(master)
    assert command.wait(timeout=30) == 128 + signal.SIGHUP
    assert {x.name for x in Path("results").iterdir()} == {"ball.csv", "ball.json", "ball.run"}


def _drain(master, end):
    os.set_blocking(master, False)
    while not end.wait(0.05):
        with contextlib.suppress(BlockingIOError):
            os.read(master, 10_000)


@pytest.mark.slow(reason="waits for an interrupt")
@pytest.mark.parametrize("declared", [False, True], ids=["read", "declared"])
def test_interrupts_end_the_reading_of_stored_records(declared, folder):
    Path("data.bin").write_bytes(b"1")
    model = load(inside="open('data.bin').close()" if declared else "Path('data.bin').read_bytes()",
                 above="from pathlib import Path")  # fmt: skip
    if declared:
        model = bd.model(t_end=0.05, data=[str(folder / "data.bin")])(model.build)
    bd.sweep(model, {"mass": [1.0]}, folder="study", jobs=1)
    # A sparse file, whose hash takes minutes.
    os.truncate("data.bin", 10**12)
    timer = threading.Timer(2.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begin = time.process_time()
    try:
        with pytest.raises(KeyboardInterrupt):
            bd.sweep(model, {"mass": [1.0]}, folder="study", jobs=1)
    finally:
        os.truncate("data.bin", 0)
    assert time.process_time() - begin < 10.0


@pytest.mark.slow(reason="a process in a process")
def test_sweeps_in_a_daemonic_pool_start_processes(folder):
    load()
    Path("pool.py").write_text(
        "import multiprocessing, beamdae as bd\n"
        "def run(_):\n"
        "    model = bd.load_model('ball.py')\n"
        "    return list(bd.sweep(model, {'mass': [1.0, 2.0]}, jobs=2).table['status'])\n"
        "if __name__ == '__main__':\n"
        "    with multiprocessing.get_context('spawn').Pool(1) as pool:\n"
        "        print(pool.map(run, [0]))\n"
    )
    command = process("pool.py", stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    output, errors = command.communicate(timeout=120)
    assert output.strip() == "[['ok', 'ok']]", errors
    assert "worker processes can be started" not in errors


@pytest.mark.slow(reason="several analyses")
@pytest.mark.parametrize("name", ["pendulum", "four_bar"])
def test_numpy_settings_of_the_caller_change_nothing(name, folder):
    model = bd.load_model(f"example:{name}")
    parameter, value = next(iter(model.parameters.items()))
    sizes = {parameter: [value]}
    calls = {
        "auto": lambda: bd.simulate(model, t_end=0.1).table().to_numpy(),
        "radau": lambda: bd.simulate(model, bd.Radau(), t_end=0.1).table().to_numpy(),
        "modes": lambda: bd.modes(model()).frequencies,
        "sweep": lambda: bd.sweep(model, sizes, t_end=0.1, jobs=1).table["status"].to_list(),
        "page": lambda: bd.simulate(model, t_end=0.1).page("a.html").name,
    }
    for call in calls.values():
        expected = call()
        with np.errstate(all="raise"):
            assert np.array_equal(call(), expected)


def test_a_lock_that_is_a_hard_link_is_not_written(folder):
    Path("mine.txt").write_text("text")
    Path("study").mkdir()
    os.link("mine.txt", "study/.lock")
    bd.sweep(load(), {"mass": [1.0]}, folder="study", jobs=1)
    assert Path("mine.txt").read_text() == "text"


@pytest.mark.parametrize("script", ["exit 0", "exit 1", "echo wrong >&2"])
def test_compilers_without_a_program_are_named(script, folder, monkeypatch):
    compiler = folder / "cc"
    compiler.write_text(f"#!/bin/sh\n{script}\n")
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))
    with pytest.raises(bd.BeamdaeError, match=r"the C compiler .*cc failed; set"):
        bd.export_fmu(load(), "ball.fmu")
    assert not Path("ball.fmu").exists()


@pytest.mark.parametrize(
    "array",
    [
        *("np.array([1, 2], 'm8[s]')", "np.array(['2020-01-01'], 'M8[D]')", "np.array(3.0)"),
        *("np.array(['a', 'bc'])", "np.array([b'a'])", "np.array([1j])", "np.zeros((0, 3))"),
        *("np.array([(1, 2.0)], 'i4,f8')", "np.ones((2, 3))[:, ::2].T", "np.float16([1])"),
        *("np.array([None, 'a'])", "np.array([True])", "np.array([(1, 2)], 'i4,m8[s]')"),
    ],
)
def test_arrays_of_every_kind_belong_to_a_model(array, folder):
    """Studies compute a fingerprint of everything on which the model function depends."""
    model = load(above=f"DATA = {array}", inside="DATA.shape")
    first = bd.sweep(model, {"mass": [1.0]}, folder="study", jobs=1)
    assert set(first.table["status"]) == {"ok"}


def create_joint(**members):
    kind = type(
        "Pin",
        (bd.Joint,),
        {
            "multipliers": (Variable("x", "N"), Variable("y", "N")),
            "reactions": ("Fx", "Fy"),
            "gap": staticmethod(lambda t, a, b: b.position - a.position),
            **members,
        },
    )
    return dataclass(frozen=True, eq=False)(kind)


def add_joint(kind):
    mech, ball = free_ball((0.0, 1.0))
    mech.add(kind("pin", mech.ground.at(0.0, 1.0), ball.point))
    return mech


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({"symbol": "hing"}, r"Pin: symbol must be one of .*did you mean 'hinge'"),
        ({"symbol": 3}, "Pin: symbol must be one of"),
        ({"_values": lambda self: []}, "Pin: the name _values replaces a private name of Part"),
        ({"_values": property(lambda self: [])}, "the name _values replaces"),
        ({"_values": ()}, "the name _values replaces"),
    ],
)
def test_mistakes_of_a_class_are_found_when_its_part_is_added(members, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        add_joint(create_joint(**members))
