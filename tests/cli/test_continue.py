"""Runs of the command that go on: tables of all parts, and none of them lost."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

import beamdae as bd
from beamdae.cli.app import app

BALL = '''
"""A ball that bounces off a floor and is pushed along it."""

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
def go(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Pictures take longer than these runs.
    monkeypatch.setattr("beamdae.cli.run_outputs.draw_run", lambda run, solution: None)
    Path("ball.py").write_text(BALL)
    return lambda *options: CliRunner().invoke(app, ["run", "ball.py", *ROWS, *options])


def read(name):
    return pd.read_csv(f"results/{name}.csv"), json.loads(Path(f"results/{name}.json").read_text())


@pytest.mark.slow(reason="four runs with many bounces")
def test_three_parts_make_the_table_of_one_run(go):
    end = ("--checkpoint", "end.json")
    assert go("--t-end", "0.305", *end).exit_code == 0
    first = Path("results/ball.csv").read_bytes()
    assert go("--t-end", "1.2", "--continue", "end.json", *end).exit_code == 0
    assert Path("results/ball_part1.csv").read_bytes() == first
    result = go("--continue", "end.json", *end)
    assert result.exit_code == 0
    assert "ball_part3.csv" in result.stdout
    assert "bounce " in result.stdout
    assert Path("results/ball_part1.csv").read_bytes() == first
    table, told = read("ball")
    whole = bd.simulate(bd.load_model("ball.py"), output_step=0.01)
    # The ends of the first parts are rows of theirs.
    t = np.sort([*whole.t, 0.305])
    assert_allclose(table["t [s]"], t, atol=1e-12)
    on_grid = table["t [s]"] != 0.305
    # Runs with errors of 100 rtol of a meter; at the bounces rates differ by their times.
    for column in ("ball.x [m]", "ball.y [m]", "energy.work_of_loads [J]"):
        assert_allclose(table[column][on_grid], whole.all_columns()[column], atol=1e-3)
    assert_allclose(table["energy.dissipated [J]"].iloc[-1], whole.ledger.iloc[-1, 5], rtol=1e-4)
    assert np.abs(table["energy.imbalance [J]"]).max() < 1e-4
    assert len(told["events"]) == len(whole.event_records)
    assert [part["file"] for part in told["parts"]] == [f"ball_part{k}.csv" for k in (1, 2, 3)]
    steps = sum(read(f"ball_part{k}")[1]["result"]["steps"] for k in (1, 2, 3))
    assert told["result"]["steps"] == steps
    assert told["result"]["last_time"] == 2.0


def test_runs_that_limits_ended_go_on_one_after_the_other(go):
    few = ("--integrator", "generalized-alpha", "--step", "0.001")
    result = go(*few, "--time-limit", "1e-9")
    assert result.exit_code == 1
    assert "to go on: --continue results/ball_end.json" in result.stdout
    _, told = read("ball")
    reached = [told["result"]["last_time"]]
    for _ in range(2):
        go(*few, "--time-limit", "1e-9", "--continue", "results/ball_end.json")
        table, told = read("ball")
        reached.append(told["result"]["last_time"])
        assert set(table["status"]) == {"limited"}
        assert np.all(np.diff(table["t [s]"]) > 0.0)
    assert 0.0 < reached[0] < reached[1] < reached[2] < 2.0
    assert go("--continue", "results/ball_end.json").exit_code == 0
    table, told = read("ball")
    assert "status" not in table
    assert [part["status"] for part in told["parts"]] == ["limited"] * 3 + ["ok"]
    assert table["t [s]"].iloc[[0, -1]].tolist() == [0.0, 2.0]


def test_an_end_can_be_gone_on_from_again(go):
    go("--t-end", "0.3", "--checkpoint", "end.json")
    go("--t-end", "0.5", "--continue", "end.json")
    assert go("--t-end", "0.6", "--continue", "end.json").exit_code == 0
    table, told = read("ball")
    assert table["t [s]"].iloc[[0, -1]].tolist() == [0.0, 0.6]
    assert len(told["parts"]) == 2


def test_what_went_on_from_a_failure_has_failed(go):
    go("--t-end", "0.3", "--checkpoint", "end.json")
    metadata = Path("results/ball.json")
    ended = {"status": "failed", "reason": "met something"}
    metadata.write_text(json.dumps(json.loads(metadata.read_text()) | ended))
    go("--t-end", "0.5", "--continue", "end.json")
    table, told = read("ball")
    assert set(table["status"]) == {told["status"]} == {told["result"]["status"]} == {"failed"}
    assert told["reason"].endswith("but it resumed from a failed run: met something")


def test_tables_of_other_runs_are_not_overwritten(go):
    go("--t-end", "0.3", "--checkpoint", "end.json")
    go("--t-end", "0.4")
    before = Path("results/ball.csv").read_bytes()
    result = go("--continue", "end.json")
    assert result.exit_code == 2
    assert "this table belongs to another run" in result.stderr
    assert Path("results/ball.csv").read_bytes() == before
    assert go("--continue", "end.json", "--out", "other").exit_code == 0
    go("--t-end", "0.3")
    go("--t-end", "0.5", "--continue", "end.json")
    Path("results/ball_part1.csv").unlink()
    result = go("--continue", "end.json")
    assert result.exit_code == 2
    assert "ball_part1.csv: this part of the run is missing" in result.stderr


def test_other_parameters_are_refused_or_accepted(go):
    go("--t-end", "0.3", "--checkpoint", "end.json")
    more = ("--set", "push=1.0", "--continue", "end.json")
    result = go(*more)
    assert result.exit_code == 2
    assert "run with other parameters, push was 0.5" in result.stderr
    assert "--accept-changes" in result.stderr
    result = go(*more, "--accept-changes")
    assert result.exit_code == 0
