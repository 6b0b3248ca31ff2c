"""Messages on the command line name options, not arguments of Python."""

import json
from pathlib import Path

import pytest
import typer
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


@pytest.mark.slow
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
