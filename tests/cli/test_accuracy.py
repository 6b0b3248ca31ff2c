"""`beamdae run --accuracy`: budget on the terminal, in JSON and on the page; refusals."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from beamdae.cli.app import app

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


def invoke(*arguments):
    return CliRunner().invoke(app, ["run", "model.py", *arguments])


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("accuracy", ["1%", "0.01", " 1 %"])
def test_the_budget_is_in_json_and_in_the_document(accuracy):
    result = invoke("--accuracy", accuracy, "--json", "--no-page")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["certificate"]["accuracy"] == pytest.approx(0.01)
    assert document["certificate"]["status"] == "ok"
    row = document["observed"]["tip.y [m]"]
    assert row["certified"] == "yes"
    assert 0.0 < row["total"] <= 0.01
    metadata = json.loads(Path("results/arm.json").read_text(encoding="utf-8"))
    assert metadata["errors"]["tip.y [m]"]["total"] == row["total"]
    assert metadata["certificate"]["runs"]


@pytest.mark.slow(reason="writes a page and a picture")
def test_the_budget_is_printed_and_on_the_page():
    result = invoke("--accuracy", "0.1%")
    assert result.exit_code == 0, result.output
    assert "certified" in result.stdout
    assert "estimated by comparison of runs" in result.stdout
    page = Path("results/arm.html").read_text(encoding="utf-8")
    assert "Certificate" in page
    assert "theory as written" in page.replace("\\n", " ")


@pytest.mark.slow(reason="a quarter of a second")
def test_a_refused_certificate_writes_the_run_and_exits_with_1():
    # The pendulum passes its unstable equilibrium with hardly any speed.
    Path("model.py").write_text(
        MODEL.replace("center=(1.0, 0.0)", "center=(1.0, 0.0), angular_velocity=4.2223"),
        encoding="utf-8",
    )
    result = invoke("--accuracy", "1%", "--t-end", "20", "--time-limit", "1e-3", "--no-page")
    assert result.exit_code in (1, 2)
    assert "time limit" in result.stderr
