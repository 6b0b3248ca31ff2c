"""`beamdae export`: file, JSON document, exit codes and messages."""

import json
from pathlib import Path

import pytest
from command_line import invoke
from model_texts import SPRUNG

MODEL = SPRUNG


def run(*arguments):
    command = ["export", "model.py", "--fmu", "model.fmu", "--platforms", "none", *arguments]
    return invoke(*command)


@pytest.mark.slow(reason="half a second")
def test_file_and_json(here):
    result = run("--outputs", "mass.x", "--parameters", "stiffness,mass", "--json", "--fmi", "3")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["files"] == ["model.fmu"]
    assert (document["inputs"], document["outputs"]) == (["push"], ["mass.x"])
    assert document["parameters"] == ["stiffness", "mass"]
    assert document["size"] == Path("model.fmu").stat().st_size


@pytest.mark.slow(reason="a quarter of a second")
def test_adaptive_steps(here):
    result = run("--integrator", "radau", "--rtol", "1e-4", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["integrator"] == "Radau(rtol=0.0001)"
    assert "Radau(rtol=" in run().stdout
    fixed = run("--integrator", "generalized-alpha", "--step", "2ms", "--option", "rho_inf=0.5")
    assert "GeneralizedAlpha(step=0.002)" in fixed.stdout
    assert "Radau(rtol=0.01)" in run("--option", "rtol=0.01").stdout
    assert run("--real-time", "2").exit_code == 2


def test_regression_warnings_of_the_trial_run_are_printed(here):
    """An FMU whose fixed steps changed the period of a vibration was written without a word."""
    arguments = [
        "--set",
        "stiffness=4e5",
        "--set",
        "stretch=0.01",
        "--integrator",
        "generalized-alpha",
    ]
    text = run(*arguments).stderr.replace("\n", " ")
    assert "the error is more than 100 % of half its range" in text
