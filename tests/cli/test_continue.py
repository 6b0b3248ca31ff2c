"""`beamdae run --continue`: tables of all parts of a resumed run."""

from __future__ import annotations

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
    # Pictures take longer than these runs.
    monkeypatch.setattr("beamdae.cli.run_outputs.draw_run", lambda run, solution: None)
    Path("ball.py").write_text(BALL)
    return lambda *arguments: invoke("run", "ball.py", *ROWS, *arguments)


def read(name):
    return pd.read_csv(f"results/{name}.csv"), json.loads(Path(f"results/{name}.json").read_text())


@pytest.mark.slow(reason="four runs with many bounces")
def test_three_parts_make_the_table_of_one_run(run):
    end = ("--checkpoint", "end.json")
    assert run("--t-end", "0.305", *end).exit_code == 0
    first = Path("results/ball.csv").read_bytes()
    assert run("--t-end", "1.2", "--continue", "end.json", *end).exit_code == 0
    assert Path("results/ball_part1.csv").read_bytes() == first
    result = run("--continue", "end.json", *end)
    assert result.exit_code == 0
    assert "ball_part3.csv" in result.stdout
    assert "bounce " in result.stdout
    assert Path("results/ball_part1.csv").read_bytes() == first
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
    assert [part["file"] for part in metadata["parts"]] == [f"ball_part{k}.csv" for k in (1, 2, 3)]
    steps = sum(read(f"ball_part{k}")[1]["result"]["steps"] for k in (1, 2, 3))
    assert metadata["result"]["steps"] == steps
    assert metadata["result"]["last_time"] == 2.0


@pytest.mark.slow(reason="a third of a second")
def test_runs_ended_by_a_limit_resume_repeatedly(run):
    settings = ("--integrator", "generalized-alpha", "--step", "0.001")
    result = run(*settings, "--time-limit", "1e-9")
    assert result.exit_code == 1
    assert "to resume: --continue results/ball_end.json" in result.stdout
    _, metadata = read("ball")
    reached = [metadata["result"]["last_time"]]
    for _ in range(2):
        run(*settings, "--time-limit", "1e-9", "--continue", "results/ball_end.json")
        table, metadata = read("ball")
        reached.append(metadata["result"]["last_time"])
        assert set(table["status"]) == {"limited"}
        assert np.all(np.diff(table["t [s]"]) > 0.0)
    assert 0.0 < reached[0] < reached[1] < reached[2] < 2.0
    assert run("--continue", "results/ball_end.json").exit_code == 0
    table, metadata = read("ball")
    assert "status" not in table
    assert [part["status"] for part in metadata["parts"]] == ["limited"] * 3 + ["ok"]
    assert table["t [s]"].iloc[[0, -1]].tolist() == [0.0, 2.0]


@pytest.mark.slow(reason="half a second and more")
def test_a_checkpoint_can_be_resumed_twice(run):
    run("--t-end", "0.3", "--checkpoint", "end.json")
    run("--t-end", "0.5", "--continue", "end.json")
    assert run("--t-end", "0.6", "--continue", "end.json").exit_code == 0
    table, metadata = read("ball")
    assert table["t [s]"].iloc[[0, -1]].tolist() == [0.0, 0.6]
    assert len(metadata["parts"]) == 2


@pytest.mark.slow(reason="a fifth of a second")
def test_a_run_resumed_from_a_failure_has_failed(run):
    run("--t-end", "0.3", "--checkpoint", "end.json")
    sidecar = Path("results/ball.json")
    failure = {"status": "failed", "reason": "met something"}
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | failure))
    run("--t-end", "0.5", "--continue", "end.json")
    table, metadata = read("ball")
    assert (
        set(table["status"]) == {metadata["status"]} == {metadata["result"]["status"]} == {"failed"}
    )
    assert metadata["reason"].endswith("but the run resumed from a failed run: met something")


@pytest.mark.slow(reason="half a second")
def test_tables_of_other_runs_are_not_overwritten(run):
    run("--t-end", "0.3", "--checkpoint", "end.json")
    run("--t-end", "0.4")
    before = Path("results/ball.csv").read_bytes()
    result = run("--continue", "end.json")
    assert result.exit_code == 2
    assert "the table belongs to another run" in result.stderr
    assert Path("results/ball.csv").read_bytes() == before
    assert run("--continue", "end.json", "--out", "other").exit_code == 0
    run("--t-end", "0.3")
    run("--t-end", "0.5", "--continue", "end.json")
    Path("results/ball_part1.csv").unlink()
    result = run("--continue", "end.json")
    assert result.exit_code == 2
    assert "ball_part1.csv: this part of the run in" in result.stderr


@pytest.mark.slow(reason="a quarter of a second")
def test_changed_parameters_need_accept_changes(run):
    run("--t-end", "0.3", "--checkpoint", "end.json")
    options = ("--set", "push=1.0", "--continue", "end.json")
    result = run(*options)
    assert result.exit_code == 2
    assert "run with other parameters (push was 0.5)" in result.stderr
    assert "--accept-changes" in result.stderr
    result = run(*options, "--accept-changes")
    assert result.exit_code == 0


def test_regression_coordinates_are_not_plotted_of_resumed_runs(run):
    """They were refused after the run, and the earlier picture was removed."""
    Path("ball.py").write_text(BALL.replace('observe("ball"', 'observe("spot"'))
    end = ("--checkpoint", "end.json", "--no-page")
    assert run("--t-end", "0.02", "--plot", "ball.x", *end).exit_code == 0
    result = run("--t-end", "0.04", "--continue", "end.json", "--x", "ball.x", "--no-page")
    assert result.exit_code == 2
    assert "run: the coordinate ball.x [m] is not in the tables of the earlier" in result.output
    assert not Path("results/ball_part2.csv").exists()


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
    assert not Path("results/ball_end.json").exists()
