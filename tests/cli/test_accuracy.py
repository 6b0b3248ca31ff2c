"""`beamdae run --accuracy`: errors on the terminal, in JSON and on the page."""

import json
from pathlib import Path

import pytest
from command_line import invoke

pytestmark = pytest.mark.usefixtures("here")

MODEL = """
import beamdae as bd


@bd.model(t_end=0.5)
def arm(angle=0.3):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", 1.0, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("tip", bob.at(1.0, 0.0))
    return mech
"""


def run(*arguments):
    return invoke("run", "model.py", *arguments)


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", ["1%", "0.01", " 1 %"])
def test_errors_are_in_json_and_in_the_document(accuracy):
    result = run("--accuracy", accuracy, "--json", "--no-page")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["accuracy"]["required"] == pytest.approx(0.01)
    assert document["accuracy"]["status"] == "ok"
    assert "the largest error" in document["accuracy"]["reason"]
    row = document["observed"]["tip.y [m]"]
    assert 0.0 < row["total"] <= 0.01
    metadata = json.loads(Path("results/arm.json").read_text(encoding="utf-8"))
    assert metadata["errors"]["tip.y [m]"]["total"] == row["total"]
    assert metadata["accuracy"] == document["accuracy"]


@pytest.mark.slow
def test_errors_are_printed_and_on_the_page():
    result = run("--accuracy", "0.1%")
    assert result.exit_code == 0, result.output
    assert "the largest error" in result.stdout
    assert "accuracy reached: " in result.stdout
    assert all(x in result.stdout for x in ("error", "largest"))
    page = Path("results/arm.html").read_text(encoding="utf-8")
    assert "the largest error" in page


@pytest.mark.slow
@pytest.mark.parametrize("columns", [(), ("--columns", "tip.y_dot")])
def test_an_accuracy_that_is_not_reached_writes_the_run_and_exits_with_1(columns):
    # The pendulum passes its unstable equilibrium with hardly any speed.
    Path("model.py").write_text(
        MODEL.replace("center=(1.0, 0.0)", "center=(1.0, 0.0), angular_velocity=4.2223"),
        encoding="utf-8",
    )
    limits = "--t-end", "20", "--time-limit", "1e-3", "--no-page", "--no-picture"
    result = run("--accuracy", "1%", *columns, *limits)
    assert result.exit_code == 1
    assert "the accuracy is not reached" in result.stderr
    assert "time limit" in result.stderr
    assert Path("results/arm.csv").exists()
    assert not list(Path("results").glob("*.run"))
