"""The command line: files, messages of usage and model errors, and start time."""

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from command_line import invoke, succeed
from study_runs import run_serially

import beamdae as bd

ARM = """
import numpy as np

import beamdae as bd


@bd.model(t_end=0.02)
def arm(elements=1, E=7e10, width=0.02, name="hinge"):
    '''A falling strip.'''
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=E, nu=0.3, rho=2700.0)
    strip = bd.Section.rectangle(alloy, width=width, height=0.005)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, strip, elements=elements))
    mech.add(bd.Revolute(name, mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    # more
    return mech
"""

NO_START = """
import casadi as ca

import beamdae as bd


@bd.model(t_end=1.0)
def nowhere():
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q", 2), ca.SX.sym("v", 2)
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1.0, 1.0], force=ca.vertcat(0.0, 0.0),
        constraints=ca.dot(q, q) + 1.0, q0=[0.9, 0.3], v0=[0.0, 0.0],
    )
"""

# The value of the law is not real after t = 0.0105 s.
FAILING_LAW = 'mech.add(bd.Moment("torque", on=beam.end, law=lambda t: t * np.sqrt(0.0105 - t)))'


def with_line(line):
    return ARM.replace("# more", line)


@pytest.fixture
def command(tmp_path, monkeypatch):
    """Return a function that runs a command in a folder with `source` as model.py."""
    monkeypatch.chdir(tmp_path)

    def run(name, source, *arguments):
        Path("model.py").write_text(source)
        return invoke(name, "model.py", *arguments)

    return run


@pytest.fixture
def serial(monkeypatch):
    """Run studies without worker processes; their outputs do not depend on them."""
    run_serially(monkeypatch)


def assert_usage_error(result, *words):
    """Check for exit code 2 and one line on stderr with these words, without a traceback."""
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, (SystemExit, type(None)))
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    for word in words:
        assert word in line


MODEL_ERRORS = {
    "open joint": (
        with_line("mech.add(bd.Revolute('far', mech.ground.at(3.0, 0.0), beam.end))"),
        [],
        "far",
        "2 m apart",
    ),
    "dependent constraints": (
        with_line("mech.add(bd.Revolute('again', mech.ground.at(0.0, 0.0), beam.start))"),
        [],
        "hinge.x",
        "again.x",
        "depend on each other",
    ),
    "impossible start": (NO_START, [], "constraint.g0", "cannot be closed"),
    "error in the model function": (
        with_line("mech.observe('ratio', 1 / 0)"),
        [],
        "arm",
        "ZeroDivisionError",
        "line 17",
    ),
    "several models": (
        ARM + "\n\n@bd.model(t_end=1.0)\ndef leg():\n    return None\n",
        [],
        "--model",
        "arm, leg",
    ),
}


@pytest.mark.parametrize(("source", "arguments", "words"), [
    pytest.param(source, arguments, words, id=name)
    for name, (source, arguments, *words) in MODEL_ERRORS.items()
])  # fmt: skip
def test_model_error_is_one_line(command, source, arguments, words):
    assert_usage_error(command("run", source, *arguments), *words)
    assert not Path("results").exists()


@pytest.mark.slow(reason="half a second")
def test_run_writes_table_settings_picture_and_page(command):
    options = "--set", "elements=2", "--out", "there/here", "--rtol", "1e-4", "--verbose"
    result = command("run", ARM, *options)
    assert result.exit_code == 0
    assert result.stderr == ""
    table = pd.read_csv("there/here/arm.csv")
    assert table["t [s]"].iloc[-1] == 0.02
    assert "tip.y [m]" in table
    sidecar = json.loads(Path("there/here/arm.json").read_text())
    assert sidecar["model"]["parameters"]["elements"] == 2
    assert sidecar["integrator"]["rtol"] == 1e-4
    assert Path("there/here/arm.png").read_bytes().startswith(b"\x89PNG")
    assert "tip.y [m]" in Path("there/here/arm.html").read_text()
    for word in ("reached the end", "error_control", "method", "drift", "tip.y [m]", "arm.csv"):
        assert word in result.stdout
    assert "arm.html" in result.stdout


def test_the_first_line_of_a_stopped_run_states_its_end_once(command):
    """It was "stopped by event early at t = 0.01 s, t = 0.01 s, 10 steps"."""
    source = with_line("mech.when('t', crosses=0.01, do='stop', name='early')")
    line = command("run", source, "--no-estimate", "--no-page", "--no-picture").stdout.split("\n")[
        0
    ]
    assert line.startswith("arm: stopped by event early at t = 0.01 s, ")
    assert line.count("t = ") == 1


@pytest.mark.slow(reason="runs a model several times")
def test_run_resumes_from_a_checkpoint(command):
    result = command("run", ARM, "--no-estimate", "--t-end", "0.01", "--checkpoint", "at/end.json")
    assert result.exit_code == 0
    assert "end.json" in result.stdout
    result = command("run", ARM, "--no-estimate", "--continue", "at/end.json")
    assert result.exit_code == 0
    assert pd.read_csv("results/arm.csv")["t [s]"].iloc[[0, -1]].tolist() == [0.0, 0.02]
    for arguments, sentence in (
        ("--set elements=2 --continue at/end.json", "coordinate 11 is 'beam.chord' in the start"),
        ("--continue nothing.json", "nothing.json"),
        ("--checkpoint at", "because at is a folder"),
        ("--continue at/end.json --start equilibrium", "run: --start and --continue are mutually"),
    ):
        assert_usage_error(command("run", ARM, *arguments.split()), sentence)


@pytest.mark.slow(reason="runs a model twice")
def test_run_reports_errors_of_beams_and_warns_once(command):
    bent = with_line('mech.add(bd.Moment("torque", on=beam.end, law=100.0))')
    result = command("run", bent, "--set", "elements=2", "--rtol", "1e-3")
    assert result.exit_code == 0
    # A run of more than 10 s reports its progress there.
    assert "warning" not in result.stderr
    text = " ".join(result.stdout.split())
    assert text.count(": the error is ") == 1
    sidecar = json.loads(Path("results/arm.json").read_text())
    (sentence,) = (x for x in sidecar["warnings"] if ": the error is " in x)
    header = next(x for x in sidecar["errors"] if x.startswith(sentence.partition(":")[0]))
    assert sidecar["errors"][header]["total"] > 0.04


@pytest.mark.slow(reason="runs a model")
def test_model_without_observables_is_drawn_and_written(command):
    result = command("run", ARM.replace('mech.observe("tip", beam.end)', ""))
    assert result.exit_code == 0
    assert Path("results/arm.png").exists()


@pytest.mark.slow(reason="half a second")
def test_failed_run_keeps_its_results(command):
    result = command("run", with_line(FAILING_LAW), "--integrator", "generalized-alpha")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("failed: stopped at t = 0.01 s")
    assert pd.read_csv("results/arm.csv")["t [s]"].iloc[-1] == pytest.approx(0.01)
    assert Path("results/arm.png").exists()


@pytest.mark.slow(reason="two seconds")
@pytest.mark.usefixtures("serial")
def test_compare_writes_tables_pictures_and_a_page(command):
    result = command("compare", ARM, "--set", "width=0.01")
    assert result.exit_code == 0, result.stderr
    folder = Path("results/arm_compare_width=0.01")
    table = pd.read_csv(folder / "cases.csv")
    assert list(table["status"]) == ["ok"] * 5
    assert table["error bound [-]"].between(0.0, 0.1).all()
    written = [line.split(": ")[1] for line in result.stdout.splitlines() if "written" in line]
    names = {Path(path).name for path in written}
    assert {"cases.csv", "summary.csv", "report.html"} <= names
    assert "work_precision.png" in names
    assert all(Path(path).stat().st_size > 0 for path in written)
    assert "differs by" in " ".join(result.stdout.split())
    assert re.search(r"\b(\d+)/\1, 0:00 left$", result.stderr.splitlines()[-1])


@pytest.mark.slow(reason="runs a study")
def test_compare_of_a_study_file(command):
    # With worker processes, which cannot import the model file.
    study = (
        ARM.replace("# more", "# more\n")
        + """

@bd.study(references=(bd.Ida(1e-6), bd.GeneralizedAlpha(1e-3)))
def widths():
    return [bd.Case(arm, {"width": w}, bd.Ida(1e-4)) for w in (0.01, 0.02)]
"""
    )
    result = command("compare", study, "--columns", "tip.angle_dot")
    assert result.exit_code == 0, result.stderr
    table = pd.read_csv("results/widths/cases.csv")
    compared = [x for x in table if "tip." in x]
    assert compared
    assert all("tip.angle_dot" in x for x in compared)
    assert list(table["width"]) == [0.01, 0.02]
    assert_usage_error(
        command("compare", study, "--set", "width=1"), "a study defines all parameters"
    )
    assert_usage_error(command("compare", study, "--model", "wdths"), "did you mean 'widths'")
    assert_usage_error(command("compare", study, "--jobs", "0"), "--jobs", "at least 1")


def test_check_reports_size_and_start(command):
    result = command("check", ARM)
    assert result.exit_code == 0
    lines = [line.split("  ", 1) for line in result.stdout.splitlines() if "  " in line]
    rows = {topic.strip(): text.strip() for topic, text in lines}
    assert "12 coordinates - 2 independent constraints" in rows["mobility"]
    assert rows["mobility"].startswith("1 with rigid beams and fixed drivers; 10 = ")
    assert "as drawn" in rows["start"]
    assert "dependent constraints" not in rows, "rows without a finding are omitted"


FALL = """import beamdae as bd


@bd.model(t_end=1.0)
def fall():
    mech = bd.Mechanism(gravity=(0.0, -10.0))
    mech.observe("ball", mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0))).point)
    return mech
"""


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_runs_with_data_print_their_differences(command):
    """Measured points were drawn, but no number compared them with the run."""
    # Differences of 3 and -4 mm; the last row is after the run.
    Path("fall.csv").write_text("t [s],ball.y [mm]\n0.1,1953\n0.5,746\n1.5,0\n", "utf-8")
    options = ["--data", "fall.csv", "--no-page", "--no-estimate", "--rtol", "1e-5"]
    text = " ".join(command("run", FALL, *options).stdout.split())
    assert "data of ball.y RMS difference 0.00354 m, largest 0.004 m at t = 0.5 s (2 val" in text
    (x,) = json.loads(command("run", FALL, *options, "--json").stdout)["data"].values()
    assert (x["largest"], x["t"], x["count"]) == (pytest.approx(0.004, rel=1e-3), 0.5, 2)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    ("rows", "options", "message"),
    [
        (
            "t [s],ball.y\n0.1,1953\n",
            [],
            "fall.csv without a unit are taken as in the model, 'ball.y' in m; write units in the "
            "header, such as 'ball.y [m]'",
        ),
        (
            "t [s],ball.y [mm],bal.x [mm],room [K]\n0.1,1953,0,295\n",
            [],
            "fall.csv contains 'bal.x [mm]' (did you mean 'ball.x'?), 'room [K]', which the run",
        ),
        (
            "t [s],ball.y [mm]\n0.1,1953\n1.5,0\n",
            [],
            "1 of 2 values of ball.y [m] in fall.csv, up to t = 1.5 s, lie outside the run from 0 "
            "to 1 s and are not compared",
        ),
        ("t [s],ball.y [mm]\n1.5,0\n", [], "1 of 1 value of ball.y [m]"),
    ],
)
def test_regression_runs_state_which_data_they_do_not_compare(command, rows, options, message):
    """Unknown columns and late rows were dropped in silence."""
    Path("fall.csv").write_text(rows, "utf-8")
    result = command("run", FALL, "--data", "fall.csv", "--no-page", "--no-estimate", *options)
    assert result.exit_code == 0
    (warning,) = (x for x in result.stderr.splitlines() if x.startswith("warning: "))
    assert message in warning
    assert ".png" in result.stdout


@pytest.mark.parametrize(
    ("rows", "options", "message"),
    [
        ("t [s],room [K]\n0.1,295\n", [], "fall.csv must contain values of a column of the run"),
        ("t [s],ball.y [mm]\n0.1,0\n", ["--plot", "ball.x"], "one of the plotted columns (ball.x"),
    ],
)
def test_data_without_a_plotted_column_is_rejected_before_the_run(command, rows, options, message):
    Path("fall.csv").write_text(rows, "utf-8")
    result = command("run", FALL, "--data", "fall.csv", *options)
    assert result.exit_code == 2
    assert message in result.stderr
    assert not Path("results").exists()


CRANK = """import beamdae as bd


@bd.model(t_end=0.1)
def crank():
    mech = bd.Mechanism()
    rod = mech.add(bd.RigidBody.rod("rod", (0, 0), (1, 0), 1.0))
    shaft = mech.ground.at(0, 0), rod.at(0, 0)
    mech.add(bd.Revolute("hinge", *shaft))
    mech.add(bd.Driver("motor", *shaft, lambda t: 0.25 * t))
    return mech
"""


def test_regression_check_begins_with_the_verdict(command):
    """Forty lines of zeros followed it."""
    lines = [x.strip() for x in command("check", CRANK).stdout.splitlines() if x.strip()]
    assert lines[0] == "crank: ready to run"
    assert not any("initial angle" in x for x in lines)


@pytest.mark.slow(reason="half a second and more")
def test_run_starts_as_requested(command):
    for state, rate in (("beam.theta_dot=2", 2.0), ("beam.theta_dot=30rpm", math.pi)):
        result = command("run", ARM, "--start", state, "--t-end", "0.01", "--no-estimate")
        assert result.exit_code == 0, result.stderr
        table = pd.read_csv("results/arm.csv")
        assert table["tip.angle_dot [rad/s]"].iloc[0] == pytest.approx(rate)
    for state, sentence in (
        ("beam.theta=x", "must be a number"),
        ("beam.thet=1", "did you mean 'beam.theta'"),
        ("beam.theta=2mm", "the unit mm measures another quantity"),
        ("rotation=30mm", "rad/s"),
        ("beam.theta", "PART.COORDINATE=VALUE"),
    ):
        assert_usage_error(command("run", ARM, "--start", state), sentence)


@pytest.mark.parametrize("name", ["dependent constraints", "impossible start", "open joint"])
def test_check_reports_the_errors_of_run(command, name):
    source, arguments, *words = MODEL_ERRORS[name]
    result = command("check", source, *arguments)
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert all(word in line for word in words)
    if name == "dependent constraints":
        text = " ".join(result.stdout.split())
        assert "hinge and again both block the translation of the beam along (1, 0)" in text


def test_list_describes_a_model_by_its_file_if_its_function_has_no_docstring(tmp_path):
    (tmp_path / "good.py").write_text("'''Of the file.'''\n" + ARM.replace("A falling strip.", ""))
    assert "Of the file." in invoke("list", str(tmp_path)).stdout


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("gone", "no such"),
        ("empty", "no model"),
        ("bad.py", "no model"),
    ],
)
def test_list_without_models(tmp_path, monkeypatch, path, words):
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    Path("bad.py").write_text("1 / 0\n")
    assert_usage_error(invoke("list", path), path, words)


def test_model_file_leaves_no_module_behind(command):
    before = set(sys.modules)
    assert command("check", ARM).exit_code == 0
    assert not [name for name in set(sys.modules) - before if "model" in name and "arm" in name]
    assert "model" not in sys.modules
    assert "beamdae_model_model" not in sys.modules


def test_model_file_may_define_dataclasses(command):
    head = "from __future__ import annotations\nfrom dataclasses import dataclass\n\n\n"
    kind = "@dataclass\nclass Size:\n    length: float = 1.0\n"
    assert command("check", head + kind + ARM).exit_code == 0


def test_public_names_can_be_imported():
    assert [name for name in bd.__all__ if not callable(getattr(bd, name))] == [
        "quantities",
        "results",
    ]
    assert set(bd.__all__) <= set(dir(bd))
    with pytest.raises(AttributeError, match="module 'beamdae' has no attribute 'Beem'"):
        _ = bd.Beem
    assert bd.results.Modes is not None  # and makes no other name known
    with pytest.raises(AttributeError, match=r"no attribute 'Modes' \(it is results\.Modes\)"):
        _ = bd.Modes


@pytest.mark.slow(reason="starts a process that imports everything")
def test_public_names_exist_whatever_was_imported_first():
    code = (
        "import beamdae.model_functions, beamdae\n"
        "names = [n for n in beamdae.__all__ if n not in ('quantities', 'results')]\n"
        "assert not [n for n in names if not callable(getattr(beamdae, n))]\n"
        "assert set(beamdae.__all__) <= set(dir(beamdae))\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_version_of_the_package_is_printed():
    result = invoke("--version")
    assert (result.exit_code, result.stdout) == (0, f"beamdae {bd.__version__}\n")


@pytest.mark.slow(reason="a fifth of a second")
def test_draw_shows_a_model_without_a_run(command):
    result = command("draw", ARM, "--set", "name=$pin")
    assert result.exit_code == 0, result.output
    assert "arm_drawing.png" in result.output
    assert Path("results/arm_drawing.png").stat().st_size > 5000
    assert_usage_error(
        command("draw", NO_START),
        "draw: nowhere consists of equations without a shape; only a Mechanism",
    )


def test_examples_are_listed_with_their_descriptions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = succeed("examples")
    models = Path(__file__).parents[2] / "models"
    names = {line.split()[0] for line in result.output.splitlines()}
    assert {file.stem for file in models.glob("*.py")} <= names
    assert "Curved-beam pendulum with a tip mass" in result.output


@pytest.mark.slow(reason="takes more than half a second")
def test_an_example_runs_by_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    succeed("run", "example:spin_up", "--t-end", "0.01", "--set", "elements=1")
    assert Path("results/spin_up.csv").exists()
    assert bd.load_model("example:spin_up").name == "spin_up"
    assert_usage_error(invoke("run", "example:spin"), "no example 'spin'", "mean 'spin_up'?")


@pytest.mark.slow(reason="runs a model")
def test_a_new_model_runs_and_is_not_overwritten(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert invoke("new", "arm.py").exit_code == 0
    succeed("run", "arm.py", "--t-end", "0.01", "--set", "push=2")
    assert_usage_error(invoke("new", "arm.py"), "arm.py: the file exists; choose another name.")
    assert invoke("new", "mine.py", "--like", "four_bar").exit_code == 0
    assert "def four_bar(" in Path("mine.py").read_text()
    assert_usage_error(invoke("new", "a b.py"), "a b.py: the file name must be a Python identifier")
    assert_usage_error(
        invoke("new", "arm.txt"), "arm.txt: the file name must be a Python identifier"
    )
    for name in ("class.py", "np.py", "bd.py"):
        assert_usage_error(
            invoke("new", name), f"{name}: the file name must be a Python identifier"
        )
    assert_usage_error(invoke("new", "b.py", "--like", "nothing"), "there is no example 'nothing'")
    assert not Path("b.py").exists()
