"""Sweeps over functions of a model without runs: frequencies, buckling loads, periodic motions."""

import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed
from mechanisms import free_ball

import beamdae as bd


@bd.model(t_end=1.0)
def oscillator(mass=2.0, stiffness=50.0, damping=3.0, frequency=1.0, length=1.0):
    """Shake a `mass` [kg] on a spring of `stiffness` [N/m] and `damping` [N s/m]."""
    if mass > 100.0:
        raise ValueError("too heavy")
    mech, block = free_ball((1.0, 0.0), mass=mass, name="block")
    wall = mech.ground.at(0.0, 0.0)
    mech.add(bd.PointOnLine("guide", wall, block.point, (1.0, 0.0)))
    mech.add(bd.Spring("spring", wall, block.point, stiffness, free_length=length))
    mech.add(bd.Spring("damper", wall, block.point, damping=damping))
    push = bd.sine(amplitude=4.0, frequency=frequency)
    mech.add(bd.Force("push", block.point, (push, 0.0)))
    return mech


def amplitude(mass, frequency, stiffness=50.0, damping=3.0):
    rate = 2.0 * math.pi * frequency
    return 4.0 / math.hypot(stiffness - mass * rate**2, damping * rate)


def first_frequency(model):
    return float(bd.modes(model).frequencies[0])


@pytest.mark.slow(reason="a fifth of a second")
def test_measures_are_columns_and_failures_have_reasons():
    measure = {
        "frequency [Hz]": first_frequency,
        "kind": lambda model: "heavy" if model.parameters["mass"] > 2.0 else "light",
    }
    with pytest.warns(bd.BeamdaeWarning, match="1 of 3 cases failed"):
        results = bd.sweep(oscillator, {"mass": [2.0, "3000 g", 200.0]}, measure=measure)
    table = results.table
    assert list(table["status"]) == ["ok", "ok", "failed"]
    for row in (0, 1):
        model = oscillator(mass=table["mass [kg]"][row])
        assert table["frequency [Hz]"][row] == first_frequency(model)
    assert np.isnan(table["frequency [Hz]"][2])
    assert list(table["kind"])[:2] == ["light", "heavy"]
    assert "too heavy" in table["reason"][2]
    assert results.sweep.units == {"mass": "kg"}
    assert "3 cases, 2 measured" in results._repr_html_()


def test_stored_measures_are_not_computed_again(tmp_path):
    tables = [
        bd.sweep(
            oscillator,
            {"mass": masses},
            measure={"clock": lambda model: time.perf_counter()},
            folder=tmp_path,
        ).table
        for masses in ([1.0, 2.0], [1.0, 2.0, 3.0])
    ]
    assert list(tables[0]["clock"]) == list(tables[1]["clock"])[:2]
    assert tables[1]["clock"].is_monotonic_increasing


def test_warnings_of_analyses_are_in_the_table():
    with pytest.warns(bd.BeamdaeWarning, match="warnings in 1 of 1 cases"):
        table = bd.sweep(oscillator, {"length": [0.9]}, measure={"f": first_frequency}).table
    assert "accelerates" in table["warnings"][0]


@pytest.mark.slow(reason="periodic motions of several models")
def test_amplitudes_and_peaks_of_periodic_motions_are_measures():
    def motion(model):
        run = bd.periodic(model, 1.0 / model.parameters["frequency"])
        return float(run.amplitudes()["half range"]["block.x [m]"])

    def peak(model):
        return bd.frequency_response(model, "frequency", (0.65, 0.95)).peaks("block.x [m]")[0][1]

    measure = {"motion [m]": motion, "peak [m]": peak}
    row = bd.sweep(oscillator, {"mass": [2.0]}, measure=measure).table.iloc[0]
    largest = max(amplitude(2.0, x) for x in np.linspace(0.65, 0.95, 1001))
    assert row["motion [m]"] == pytest.approx(amplitude(2.0, 1.0), rel=1e-3)
    assert row["peak [m]"] == pytest.approx(largest, rel=2e-3)


SWEEP_FILE = '''
import beamdae as bd


@bd.model(t_end=1.0)
def drop(height=2.0):
    """Drop a mass from a `height` [m]."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.add(bd.PointMass("bob", 1.0, at=(0.0, height)))
    return mech


@bd.sweep(drop, measure={"parts": lambda model: len(model().parts)})
def heights():
    return {"height": [1.0, 2.0]}
'''


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("drops.py").write_text(SWEEP_FILE, encoding="utf-8")


def measure(*options):
    return invoke("sweep", "drops.py", *options, "--no-page", "--no-picture")


@pytest.mark.slow(reason="starts worker processes")
def test_the_command_measures(here):
    result = measure("--jobs", "1")
    assert result.exit_code == 0, result.output
    assert "2 cases, 2 measured" in result.output
    assert Path("results/heights/sweep.csv").read_text().startswith("height [m],status,parts,")
    result = measure("--over", "height=50cm,1", "--modes", "1", "--jobs", "1")
    assert result.exit_code == 0, result.output
    assert "frequency 1" in result.output


@pytest.mark.slow(reason="starts worker processes")
def test_the_command_measures_modes_and_critical_loads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    options = ("--over", "elements=2", "--jobs", "1", "--no-page", "--no-picture")
    arch = bd.load_model("example:shallow_arch")(elements=2)
    expected = {"modes": bd.modes(arch, n=2).frequencies, "buckling": bd.buckling(arch, 2).factors}
    for option, numbers in expected.items():
        succeed("sweep", "example:shallow_arch", f"--{option}", "2", "--out", option, *options)
        (path,) = (tmp_path / option).rglob("sweep.csv")
        row = pd.read_csv(path).filter(like="frequency" if option == "modes" else option).iloc[0]
        assert list(row) == pytest.approx(numbers, rel=1e-12)


READER = """
import sys
from pathlib import Path

import beamdae as bd


@bd.model(t_end=1.0)
def oscillator(mass=2.0):
    mech = bd.Mechanism()
    block = mech.add(bd.PointMass("block", mass, at=(1.0, 0.0)))
    wall = mech.ground.at(0.0, 0.0)
    mech.add(bd.PointOnLine("guide", wall, block.point, (1.0, 0.0)))
    stiffness = float(Path("stiffness.txt").read_text())
    mech.add(bd.Spring("spring", wall, block.point, stiffness, free_length=1.0))
    return mech


def frequency(model):
    return float(bd.modes(model).frequencies[0])


if __name__ == "__main__":
    swept = bd.sweep(oscillator, {"mass": [2.0]}, folder="swept", measure={"frequency": frequency})
    print(swept.table["frequency"].iloc[0])
"""


@pytest.mark.slow(reason="two processes")
def test_regression_measures_are_repeated_after_a_file_of_the_model_has_changed(tmp_path):
    """Reads of the module of the model were recorded too late."""
    (tmp_path / "reader.py").write_text(READER)
    frequencies = []
    for stiffness in ("100", "400"):
        (tmp_path / "stiffness.txt").write_text(stiffness)
        run = subprocess.run(
            [sys.executable, "reader.py"], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        frequencies.append(float(run.stdout))
    assert frequencies[1] == pytest.approx(2.0 * frequencies[0], rel=1e-9)


def test_regression_measured_cases_have_no_rows_and_say_why(tmp_path):
    swept = bd.sweep(oscillator, {"stiffness": [50.0, 100.0]}, measure={"f": first_frequency})
    with pytest.raises(bd.BeamdaeError, match="has no rows: the model was measured, not run"):
        swept.run(stiffness=50.0)
    assert swept.runs == []
    assert swept.page(tmp_path / "page.html").stat().st_size > 1000
