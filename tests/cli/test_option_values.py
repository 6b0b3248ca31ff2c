"""Values of command-line options that are converted without pydantic."""

import numpy as np
import pandas as pd
import pytest
from command_line import invoke


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


@pytest.mark.slow
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
