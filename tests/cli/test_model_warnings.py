"""Every command prints the warnings of the model function, once, also as JSON."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed

MODEL = """
import beamdae as bd


@bd.model(t_end=0.02)
def spring(stiffness=100.0, frequency=1.0):
    steps = bd.table([0.0, 1.0, 1.1, 2.0, 3.0], [0.0, 0.0, 1.0, 1.0, 1.0], "spline", name="stop")
    mech = bd.Mechanism()
    strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002, damping=1e-3)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (0.4, 0.0)), strip, 2, strain="green"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (-float(steps(1.5)), bd.sine(0.1, frequency))))
    mech.add(bd.Spring("spring", mech.ground.at(0.4, 0.1), beam.end, stiffness, 1.0))
    mech.observe("tip", beam.end)
    return mech
"""
SENTENCE = "stop: the spline reaches "
COMMANDS = {
    "check": (),
    "run": (),
    "run --plot": ("--plot", "tip.y"),
    "run --accuracy": ("--accuracy", "5%"),
    "static": (),
    "static --plot": ("--plot", "tip.y"),
    "modes": (),
    "buckling": ("--load", "push"),
    "bode": ("--output", "tip.y", "--frequencies", "1:10"),
    "periodic": ("--period", "1", "--settle", "1"),
    "response": ("--over", "frequency=100:110", "--max-points", "2", "--settle", "1"),
    "optimize": ("--by", "stiffness", "--minimize", "mass"),
    "fit": ("data.csv", "--by", "stiffness", "--max-evaluations", "1"),
    "draw": (),
    "sweep": ("--over", "stiffness=100,200", "--jobs", "1"),
    "compare": ("--jobs", "1"),
}
FAST = ("run", "static", "modes", "buckling", "draw")
SLOW = pytest.mark.slow(reason="several runs or a picture")
WITHOUT_PICTURES = ("check", "draw", "optimize")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("spring.py").write_text(MODEL, encoding="utf-8")
    times = np.linspace(0.0, 0.02, 21)
    pd.DataFrame({"t [s]": times, "tip.y [m]": -1e-4 * times}).to_csv("data.csv", index=False)
    return tmp_path


def run(name, *more):
    command, *_ = name.split()
    pictures = () if command in WITHOUT_PICTURES else ("--no-picture",)
    pictures = () if "--plot" in name else pictures
    arguments = [command, "spring.py", *COMMANDS[name], *pictures, *more]
    return invoke(*arguments)


@pytest.mark.parametrize(
    "name",
    [x if x in FAST else pytest.param(x, marks=SLOW) for x in COMMANDS],
)
def test_regression_commands_print_the_warnings_of_model_functions(folder, name):
    """They were ignored with the warnings of the analysis, which are printed with its result."""
    result = run(name)
    assert result.exit_code in (0, 1), result.output
    # It is printed before the run, and again where a result is a table with all its warnings.
    counts = (1, 2) if name in ("check", "compare", "response") else (1,)
    assert result.output.count(SENTENCE) in counts, result.output
    document = json.loads(run(name, "--json").stdout)
    assert sum(SENTENCE in x for x in document["warnings"]) in counts
    for page in folder.glob("results/**/*.html"):
        assert SENTENCE in page.read_text(encoding="utf-8"), page


@pytest.mark.slow(reason="a second")
def test_regression_overshoots_of_tables_are_printed_before_the_run(folder):
    """A run of 17 s gave up before the table that caused it was named."""
    result = run("run")
    assert result.output.index(SENTENCE) < result.output.index("tip.y"), result.output


@pytest.mark.slow(reason="half a second")
def test_regression_run_compares_with_more_accurate_beams(folder):
    """The command, which estimates errors of time steps itself, also left out those of beams."""
    soft = MODEL.replace("bd.sine(0.1, frequency)", "15.0").replace("t_end=0.02", "t_end=0.3")
    Path("soft.py").write_text(soft, encoding="utf-8")
    succeed("run", "soft.py", "--no-page")
    errors = json.loads(Path("results/spring.json").read_text(encoding="utf-8"))["errors"]
    # Two elements that bend by 0.6 rad with moderate strains; steps cause 1e-3.
    assert 0.01 < errors["tip.x [m]"]["total"] < 0.06
