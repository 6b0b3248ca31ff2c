"""Values of command-line options that are converted without pydantic."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import typer
from typer.core import TyperCommand
from typer.testing import CliRunner

import beamdae as bd
from beamdae.cli import option_values
from beamdae.cli.app import app, create_app
from beamdae.cli.options import parse_number, parse_seconds, split_names


def test_values_have_the_types_of_the_options(monkeypatch):
    """The conversion agrees with Typer's, which converts everything if nothing is plain."""
    app = typer.Typer()
    received = []

    @app.command()
    def command(
        path: Path,
        name: str = "auto",
        rtol: float | None = None,
        jobs: int | None = None,
        settings: list[str] | None = None,
    ) -> None:
        received.append((path, name, rtol, jobs, settings))

    def run():
        received.clear()
        for line in lines:
            assert CliRunner().invoke(app, line).exit_code == 0
        return list(received)

    lines = [
        ["model.py"],
        ["model.py", "--name", "ida", "--rtol", "1e-6", "--jobs", "2"],
        ["model.py", "--rtol", " 2 ", "--jobs", "3.0", "--settings", "a=1", "--settings", "b"],
    ]
    expected = run()
    get_params = TyperCommand.get_params

    def get_plain_params(self, ctx):
        parameters = get_params(self, ctx)
        for parameter in parameters:
            option_values.convert_plain_values(parameter)
        return parameters

    monkeypatch.setattr(TyperCommand, "get_params", get_plain_params)
    assert run() == expected
    assert received[0] == (Path("model.py"), "auto", None, None, None)
    assert received[2][2:] == (2.0, 3, ["a=1", "b"])


@pytest.mark.parametrize("option", [["--rtol", "fast"], ["--rtol", ""], ["--max-order"]])
def test_values_that_are_not_plain_are_rejected_by_typer(option):
    result = CliRunner().invoke(create_app("run"), ["run", "example:hub_beam", *option])
    assert result.exit_code == 2
    assert option[0] in result.stderr


def test_an_application_has_only_the_chosen_commands():
    result = CliRunner().invoke(create_app("run"), ["--help"])
    assert "run" in result.stdout
    assert "sweep" not in result.stdout
    assert "sweep" in CliRunner().invoke(create_app(), ["--help"]).stdout


def test_numbers_of_options_may_have_units():
    assert parse_number("3000rpm", "rad/s") == pytest.approx(100.0 * np.pi, rel=1e-15)
    assert parse_number("-2.5 rad/s", "rad/s") == parse_number("-2.5", "rad/s") == -2.5
    assert parse_seconds("20ms") == 0.02
    for text, message in (
        ("3kg", "'3kg': the unit kg measures another quantity; give the value in s."),
        ("3 foos", "'3 foos': the unit foos is unknown"),
        ("fast", "'fast' is not a number in s, with or without a unit."),
    ):
        with pytest.raises(typer.BadParameter, match=re.escape(message)):
            parse_seconds(text)


@pytest.mark.slow(reason="a fifth of a second")
def test_times_and_speeds_of_commands_may_have_units(tmp_path):
    folder = tmp_path / "out"
    skipped = ["--no-page", "--no-picture", "--out", str(folder)]
    run = ["run", "example:governor", "--t-end", "2ms", "--output-step", "1ms", "--no-estimate"]
    assert CliRunner().invoke(create_app("run"), [*run, *skipped]).exit_code == 0
    table = pd.read_csv(next(folder.glob("*.csv")))
    np.testing.assert_allclose(table["t [s]"], [0.0, 1e-3, 2e-3], rtol=1e-12)


def test_several_speeds_with_units_give_a_campbell_diagram(tmp_path, monkeypatch):
    received = []
    monkeypatch.setattr(
        "beamdae.analysis.linear_dynamics.campbell_diagram.campbell",
        lambda mechanism, speeds, *rest, **options: received.append(speeds),
    )
    options = ["--speed", "60rpm", "--speed", "4", "--out", str(tmp_path)]
    CliRunner().invoke(create_app("modes"), ["modes", "example:governor", *options])
    assert received == [pytest.approx([2.0 * np.pi, 4.0])]


def test_names_are_separated_by_commas_unless_a_name_contains_one():
    """`--by k,e` was a list of names, `--plot tip.y,tip.x` one unknown column."""

    @bd.model(t_end=1.0)
    def masses():
        mech = bd.Mechanism()
        mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0)))
        mech.add(bd.Force("push, right", mass.point, (1.0, 0.0)))
        mech.observe("a, b", mass.point)
        return mech

    assert split_names(None) == split_names([]) == split_names("") == split_names(" , ") == []
    assert split_names("k, e") == split_names(["k", "e"]) == split_names(["k,e"]) == ["k", "e"]
    texts = ["a, b", "a, b.x", "a, b.y [m]", "push, right", "c,d"]
    assert split_names(texts, masses) == [*texts[:-1], "c", "d"]


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
    result = CliRunner().invoke(app, [command, str(path), *options, "--out", str(tmp_path)])
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
