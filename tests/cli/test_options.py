"""Options of commands: names in messages, values with units, starts and completion."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from command_line import invoke
from terminals import process
from typer.testing import CliRunner

from beamdae.cli.app import app, create_app
from beamdae.report.option_names import name_options, use_options
from beamdae.report.page.page_file import write_page

MODEL = """
import beamdae as bd


@bd.model(t_end=1.0)
def mass(force=1.0, step=0.1):
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0)))
    if step < 0.0:
        raise ValueError("pass step= above 0")
    mech.add(bd.Force("load", mass.point, (bd.sine(force, 0.25), 0.0)))
    mech.observe("mass", mass.point)
    return mech
"""


COMMAND = ["periodic", "mass.py", "--settle", "1"]


@pytest.mark.parametrize(
    ("command", "sentence", "expected"),
    [
        ("periodic", "pass period= or period_guess=.", "pass --period or --period-guess."),
        ("periodic", "change start= or increase settle=", "change --start or increase --settle"),
        ("static", "use control='arc length' to", 'use --control "arc length" to'),
        ("modes", "use damping=False", "use --no-damping"),
        ("fit", "pass bounds={name: (lower, upper)}.", "pass --bounds NAME=LOW:HIGH."),
        ("run", "pass accept_changes=True.", "pass --accept-changes."),
        ("run", "show them with output_step=1e-05.", "show them with --output-step 1e-05."),
        ("run", "simulate: t_end must be positive.", "simulate: --t-end must be positive."),
        ("static", "equilibrium: to must name a", "equilibrium: --to must name a"),
        ("sweep", "sweep: jobs must be", "sweep: --jobs must be"),
        ("fit", "with offset=['a.x', 'a.y'], or", "with --offset a.x,a.y, or"),
        ("static", "for example with switch=[1, 1]", "for example with --switch 1 --switch 1"),
        # Arguments of the call that the command does not have.
        ("optimize", "equilibrium: use switch=2.", "equilibrium: use bd.equilibrium(switch=2)."),
        # Code, and arguments of parts.
        (
            "run",
            "build the model with bd.Mechanism(start='equilibrium').",
            "build the model with bd.Mechanism(start='equilibrium').",
        ),
        (
            "modes",
            "use Frequency(number, about='equilibrium').",
            "use Frequency(number, about='equilibrium').",
        ),
        ("run", "table a.csv: pass x= and y= with", "table a.csv: pass x= and y= with"),
        ("run", "beam: use formulation='exact'.", "beam: use formulation='exact'."),
        ("run", "beam: formulation must be 'exact'.", "beam: formulation must be 'exact'."),
        # Not options of the command, values of options, equations and errors of a model file.
        ("run", "--set step=: a value is missing.", "--set step=: a value is missing."),
        ("static", "ends at t = 1 s, x=3", "ends at t = 1 s, x=3"),
        (
            "run",
            "m: the model function in m.py failed: ValueError: pass t_end=.",
            "m: the model function in m.py failed: ValueError: pass t_end=.",
        ),
    ],
)
def test_arguments_become_options(command, sentence, expected):
    with use_options(typer.main.get_command(create_app()).commands[command].params):
        assert name_options(sentence) == name_options(expected) == expected
    assert name_options(sentence) == sentence


def test_regression_notes_of_pages_name_options(tmp_path):
    """They named arguments of Python."""
    path = tmp_path / "page.html"
    with use_options(typer.main.get_command(create_app()).commands["run"].params):
        write_page(path, {"notes": ["rows are coarse; use output_step=1e-3 or reduce t_end=."]})
    assert "or reduce --t-end." in path.read_text(encoding="utf-8")


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_errors_of_commands_name_their_options(tmp_path, monkeypatch):
    """`periodic` asked for period=, which is an argument in Python."""
    monkeypatch.chdir(tmp_path)
    Path("mass.py").write_text(MODEL, encoding="utf-8")
    result = CliRunner().invoke(app, COMMAND)
    assert result.exit_code == 2
    assert "pass their period with --period." in result.stderr
    document = json.loads(CliRunner().invoke(app, [*COMMAND, "--json"]).stdout)
    assert document["errors"] == [result.stderr.strip()]
    result = CliRunner().invoke(app, [*COMMAND, "--set", "step=-1"])
    assert "pass step= above 0" in result.stderr


@pytest.mark.parametrize(
    "option",
    [
        ["--rtol", "fast"],
        ["--rtol", ""],
        ["--option"],
        ["--t-end", "3kg"],
        ["--t-end", "3 foos"],
    ],
)
def test_values_that_are_not_plain_are_rejected_by_typer(option):
    result = invoke("run", "example:hub_beam", *option)
    assert result.exit_code == 2
    assert option[0] in result.stderr


@pytest.mark.slow(reason="a fifth of a second")
def test_times_and_speeds_of_commands_may_have_units(tmp_path):
    folder = tmp_path / "out"
    skipped = ["--no-page", "--no-picture", "--out", str(folder)]
    run = ["run", "example:governor", "--t-end", "2ms", "--output-step", "1ms", "--no-estimate"]
    assert invoke(*run, *skipped).exit_code == 0
    table = pd.read_csv(next(folder.glob("*.csv")))
    np.testing.assert_allclose(table["t [s]"], [0.0, 1e-3, 2e-3], rtol=1e-12)


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "--plot", "tip.x,tip.y", "--no-page"],
        ["static", "--plot", "tip.x, tip.y", "--load", "pull,gravity", "--no-page"],
        ["buckling", "--load", "pull,gravity", "--no-page"],
        ["run", "--plot", "tip.x,tip.z"],
    ],
)
def test_lists_of_names_are_accepted_by_all_commands(arguments, tmp_path):
    path = tmp_path / "leaf.py"
    path.write_text(LEAF)
    command, *options = arguments
    result = invoke(command, path, *options, "--out", tmp_path)
    if "tip.z" in options[-1]:
        assert result.exit_code == 2
        assert "there is no column 'tip.z'" in " ".join(result.output.split())
    else:
        assert result.exit_code == 0, result.output


LEAF = """
import beamdae as bd


@bd.model(t_end=0.01)
def leaf():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.002)
    beam = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.0, 0.3)), section, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("pull", beam.end, (0.0, -1.0)))
    mech.observe("tip", beam.end)
    return mech
"""


START_MODEL = Path(__file__).parents[2] / "models" / "hub_beam.py"


@pytest.mark.slow(reason="starts a process for each command")
@pytest.mark.parametrize(
    ("command", "never"),
    [
        (["list", str(START_MODEL)], ("casadi", "scipy", "pandas")),
        (["examples"], ("casadi", "scipy", "pandas")),
        (["--help"], ("casadi", "numpy", "scipy", "pandas", "matplotlib", "sksundae")),
        (
            ["run", str(START_MODEL), "--t-end", "0.01", "--no-picture", "--no-page"],
            ("pandas", "matplotlib", "scipy.optimize", "distributed", "beamdae.studies"),
        ),
        (["check", str(START_MODEL)], ("pandas", "matplotlib")),
        (["static", str(START_MODEL.with_name("pendulum.py"))], ("pandas", "scipy.optimize")),
        (["modes", str(START_MODEL.with_name("pendulum.py"))], ("scipy.optimize",)),
        (
            ["draw", str(START_MODEL)],
            (
                *("pandas", "scipy.optimize", "llvmlite", "threadpoolctl"),
                *("beamdae.analysis", "beamdae.integrators", "beamdae.simulation"),
                *("beamdae.equations.equations_of_motion", "beamdae.results.solution"),
                *("beamdae.parts.joints.rolling", "beamdae.parts.forces.springs"),
            ),
        ),
    ],
)
def test_commands_import_only_what_they_need(command, never, tmp_path):
    """Pictures and pages imported pandas and all analyses; tables of models imported CasADi."""
    code = f"""
import runpy, sys
sys.argv = ["beamdae", *{command!r}]
try:
    runpy.run_module("beamdae", run_name="__main__")
except SystemExit as end:
    assert not end.code, end.code
print("imported:", *sys.modules)
"""
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    imported = result.stdout.splitlines()[-1].split()
    assert "beamdae.cli.app" in imported
    assert not [name for name in imported if name.startswith(never)]


@pytest.mark.slow(reason="starts a process")
def test_regression_the_plot_of_a_run_does_not_import_pandas(tmp_path):
    code = """
import sys
import beamdae as bd
mech = bd.Mechanism(gravity=(0.0, -9.81))
ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
mech.observe("ball", ball.point)
bd.simulate(mech, t_end=0.1).plot("ball.y").save("ball.png")
assert "matplotlib" in sys.modules
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)


@pytest.mark.slow(reason="starts a process")
def test_runs_of_scripts_import_no_displays():
    code = """
import sys
import beamdae as bd
mech = bd.Mechanism(gravity=(0.0, -9.81))
mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
bd.simulate(mech, t_end=0.1)
assert not {"rich", "typer", "html", "pandas", "matplotlib"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow(reason="starts a process")
def test_completion_is_installed_for_the_named_shell(here):
    command = process(
        "--install-completion",
        "bash",
        environment={"HOME": str(here), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
    )
    _, errors = command.communicate(timeout=60)
    assert command.returncode == 0, errors
    assert "_BEAMDAE_COMPLETE" in Path(".bash_completions/beamdae.sh").read_text()
