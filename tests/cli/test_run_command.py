"""`beamdae run`: runs that continue, and required accuracy."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke
from numpy.testing import assert_allclose

import beamdae as bd

BALL = '''
"""A ball that bounces on a floor, with a horizontal force."""

import beamdae as bd


@bd.model(t_end=2.0)
def ball(push=0.5):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0)))
    mech.add(bd.Force("push", ball.point, (push, 0.0)))
    gap = bd.LineSurface(mech.ground.at(0.0, 0.0)).gap(ball.point)
    mech.observe("ball", ball.point)
    mech.observe("gap", gap)
    mech.when(gap, 0.0, "down", bd.impact(gap, 0.8), "bounce")
    return mech
'''


ROWS = ("--output-step", "0.01", "--no-estimate")


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ball.py").write_text(BALL)
    return lambda *arguments: invoke("run", "ball.py", *ROWS, *arguments)


def read(name):
    return pd.read_csv(f"results/{name}.csv"), json.loads(Path(f"results/{name}.json").read_text())


@pytest.mark.slow(reason="four runs with many bounces")
def test_three_parts_make_the_table_of_one_run(run):
    end = ("--checkpoint", "end.run")
    assert run("--t-end", "0.305", *end).exit_code == 0
    assert run("--t-end", "1.2", "--continue", "end.run", *end).exit_code == 0
    result = run("--continue", "end.run", *end)
    assert result.exit_code == 0
    assert "bounce " in result.stdout
    table, metadata = read("ball")
    whole = bd.simulate(bd.load_model("ball.py"), output_step=0.01)
    # The end of the first part is an additional row.
    t = np.sort([*whole.t, 0.305])
    assert_allclose(table["t [s]"], t, atol=1e-12)
    on_grid = table["t [s]"] != 0.305
    # Errors of both runs are below 100 rtol of a meter; velocities jump at the bounces.
    for column in ("ball.x [m]", "ball.y [m]", "energy.work_of_loads [J]"):
        assert_allclose(table[column][on_grid], whole.all_columns()[column], atol=1e-3)
    assert_allclose(table["energy.dissipated [J]"].iloc[-1], whole.energies.iloc[-1, 5], rtol=1e-4)
    assert np.abs(table["energy.imbalance [J]"]).max() < 1e-4
    assert len(metadata["events"]) == len(whole.event_records)
    assert metadata["result"]["last_time"] == 2.0
    saved = bd.load("end.run", bd.load_model("ball.py"))
    assert_allclose(saved.t, t, atol=1e-12)
    assert metadata["result"]["steps"] == saved.statistics.steps


@pytest.mark.slow(reason="a third of a second")
def test_runs_ended_by_a_limit_resume_repeatedly(run):
    settings = ("--integrator", "generalized-alpha", "--step", "0.001")
    result = run(*settings, "--time-limit", "1e-9")
    assert result.exit_code == 1
    assert "to resume: --continue results/ball.run\n" in result.stdout
    _, metadata = read("ball")
    reached = [metadata["result"]["last_time"]]
    for _ in range(2):
        run(*settings, "--time-limit", "1e-9", "--continue", "results/ball.run")
        table, metadata = read("ball")
        reached.append(metadata["result"]["last_time"])
        assert set(table["status"]) == {"limited"}
        assert np.all(np.diff(table["t [s]"]) > 0.0)
    assert 0.0 < reached[0] < reached[1] < reached[2] < 2.0
    assert run("--continue", "results/ball.run").exit_code == 0
    table, _ = read("ball")
    assert "status" not in table
    assert table["t [s]"].iloc[[0, -1]].tolist() == [0.0, 2.0]


@pytest.mark.slow(reason="half a second and more")
def test_a_file_can_be_resumed_twice(run):
    run("--t-end", "0.3", "--checkpoint", "end.run")
    run("--t-end", "0.5", "--continue", "end.run")
    assert run("--t-end", "0.6", "--continue", "end.run").exit_code == 0
    table, _ = read("ball")
    assert table["t [s]"].iloc[[0, -1]].tolist() == [0.0, 0.6]


def test_the_hint_to_resume_selects_the_model(run):
    limited = "--integrator", "radau", "--time-limit", "1e-9", "--set", "push=0.25"
    result = run(*limited, "--model", "ball")
    assert "--continue results/ball.run --model ball --set push=0.25\n" in result.stdout
    Path("ball.py").write_text(BALL.replace('"ball"', '"spot"'))
    result = run("--continue", "results/ball.run", "--accept-changes")
    assert result.stderr.startswith("error: --continue results/ball.run: coordinate 1 is 'ball.x' ")


@pytest.mark.slow(reason="a quarter of a second")
def test_changed_parameters_need_accept_changes(run):
    run("--t-end", "0.3", "--checkpoint", "end.run")
    options = ("--set", "push=1.0", "--continue", "end.run")
    result = run(*options)
    assert result.exit_code == 2
    assert "run with other parameters (push was 0.5)" in result.stderr
    assert "--accept-changes" in result.stderr
    result = run(*options, "--accept-changes")
    assert result.exit_code == 0


@pytest.mark.slow(reason="writes two pictures")
def test_coordinates_of_resumed_runs_are_plotted(run):
    Path("ball.py").write_text(BALL.replace('observe("ball"', 'observe("spot"'))
    end = ("--checkpoint", "end.run", "--no-page")
    assert run("--t-end", "0.02", "--plot", "ball.x", *end).exit_code == 0
    result = run("--t-end", "0.04", "--continue", "end.run", "--x", "ball.x", "--no-page")
    assert result.exit_code == 0, result.output
    assert Path("results/ball.png").stat().st_size > 5000


def test_a_run_interrupted_at_its_end_is_not_resumed(run, monkeypatch):
    """The advice to resume led to an error: the end time must be later than the start."""
    simulate = bd.simulate

    def interrupted(*arguments, **options):
        run = simulate(*arguments, **options)
        sentence = "interrupted after the last step"
        return replace(run, status=replace(run.status, kind="interrupted", sentence=sentence))

    monkeypatch.setattr("beamdae.simulation.simulate", interrupted)
    result = run("--t-end", "0.1", "--no-page")
    assert "interrupted after the last step" in result.stderr
    assert "--continue" not in result.output
    assert not Path("results/ball.run").exists()


HERE = pytest.mark.usefixtures("here")
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


def run_accurately(*arguments):
    return invoke("run", "model.py", *arguments)


@HERE
@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("accuracy", ["1%", "0.01", " 1 %"])
def test_errors_are_in_json_and_in_the_document(accuracy):
    result = run_accurately("--accuracy", accuracy, "--json", "--no-page")
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


@HERE
@pytest.mark.slow(reason="writes a page and a picture")
def test_errors_are_printed_and_on_the_page():
    result = run_accurately("--accuracy", "0.1%")
    assert result.exit_code == 0, result.output
    assert "the largest error" in result.stdout
    assert "accuracy reached: " in result.stdout
    assert all(x in result.stdout for x in ("error", "largest"))
    page = Path("results/arm.html").read_text(encoding="utf-8")
    assert "the largest error" in page


@HERE
@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("columns", [(), ("--columns", "tip.y_dot")])
def test_an_accuracy_that_is_not_reached_writes_the_run_and_exits_with_1(columns):
    # The pendulum passes its unstable equilibrium with hardly any speed.
    Path("model.py").write_text(
        MODEL.replace("center=(1.0, 0.0)", "center=(1.0, 0.0), angular_velocity=4.2223"),
        encoding="utf-8",
    )
    limits = "--t-end", "20", "--time-limit", "1e-3", "--no-page", "--no-picture"
    result = run_accurately("--accuracy", "1%", *columns, *limits)
    assert result.exit_code == 1
    assert "the accuracy is not reached" in result.stderr
    assert "time limit" in result.stderr
    assert Path("results/arm.csv").exists()
    assert not list(Path("results").glob("*.run"))
