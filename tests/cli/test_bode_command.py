"""`beamdae bode`: table, picture, page and usage errors."""

import json

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed
from model_texts import SHAKER
from numpy.testing import assert_allclose
from PIL import Image


@pytest.fixture
def bode(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shaker.py").write_text(SHAKER)
    return lambda *arguments: invoke("bode", "shaker.py", *arguments)


def test_bode_writes_a_table_with_the_peak(bode, tmp_path):
    result = bode("--input", "push.Fx", "--output", "mass.x", "--json", "--no-page", "--no-picture")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    (peak,) = document["peaks"]
    assert peak["frequency [Hz]"] == pytest.approx(10.0 / (2.0 * np.pi), rel=1e-6)
    assert peak["magnitude"] == pytest.approx(1.0 / (0.02 * 10.0), rel=1e-6)
    table = pd.read_csv(tmp_path / "results/shaker_bode.csv")
    assert table["mass.x / push.Fx magnitude [m/N]"].max() == pytest.approx(5.0, rel=1e-6)
    assert len(document["response"]) == len(table)


LOOP = """
import beamdae as bd


@bd.model(t_end=1.0)
def loop(kp=1e3):
    mech = bd.Mechanism()
    slide = mech.add(bd.PointMass("slide", 2.0, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), slide.point, (1.0, 0.0)))
    x = mech.sensor("x", slide.point, "x")
    v = mech.sensor("v", slide.point, "x_dot")
    command = bd.pid(mech, "servo", 1.0 - x, kp=kp, kd=40.0, rate=-v)
    idle = bd.pid(mech, "idle", mech.input("target") - 1.0, kp=1.0)
    mech.add(bd.Force("push", slide.point, (command + idle, 0.0)))
    mech.observe("slide", slide.point)
    return mech
"""


@pytest.mark.slow(reason="a quarter of a second")
def test_bode_states_margins_of_pid_loops_and_why_one_has_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loop.py").write_text(LOOP)
    arguments = ["bode", "loop.py", "--input", "push.Fx", "--no-page", "--no-picture"]
    shown = succeed(*arguments)
    assert "loop of servo" in shown.stdout
    assert "warning: margins: the command of idle does not depend on the motion" in shown.stdout
    result = invoke(*arguments, "--json")
    (crossover,) = json.loads(result.stdout)["margins"]["servo"]
    # |kp + kd s| = m w^2 at the gain crossover, and the plant turns the phase by -180 degrees.
    w = np.sqrt((40.0**2 + np.sqrt(40.0**4 + 4.0 * 2.0**2 * 1e6)) / (2.0 * 2.0**2))
    assert_allclose(crossover["frequency [Hz]"], w / (2.0 * np.pi), rtol=1e-8)
    margin = np.degrees(np.arctan2(40.0 * w, 1e3))
    assert_allclose(crossover["phase margin [deg]"], margin, rtol=1e-8)


TRAIN = """
import beamdae as bd


@bd.model(t_end=1.0)
def train():
    mech = bd.Mechanism()
    end = mech.ground.at(0.0, 0.0)
    for k in range(1, 13):
        mass = mech.add(bd.PointMass(f"mass {k}", 1.0, at=(k, 0.0)))
        mech.add(bd.Spring(f"spring {k}", end, mass.point, 1e3, 0.01))
        end = mass.point
    mech.add(bd.Force("push", end, (0.0, 0.0)))
    mech.observe("mass", end)
    return mech
"""


@pytest.mark.slow(reason="many modes")
def test_the_first_of_many_peaks_are_shown(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "train.py").write_text(TRAIN)
    arguments = ["bode", "train.py", "--no-page", "--no-picture"]
    peaks = json.loads(invoke(*arguments, "--json").stdout)["peaks"]
    shown = invoke(*arguments).stdout
    assert f"not shown: {len(peaks) - 24} rows; see --json" in shown
    are_shown = [f"{peak['frequency [Hz]']:.5g} " in shown for peak in peaks[:24]]
    assert all(are_shown)


@pytest.mark.slow(reason="draws a picture")
def test_bode_writes_a_picture_and_a_page(bode, tmp_path):
    result = bode("--output", "mass.x,mass.x_dot", "--frequencies", "1Hz:0.01kHz")
    assert result.exit_code == 0, result.output
    assert "output / input" in result.stdout
    with Image.open(tmp_path / "results/shaker_bode.png") as picture:
        assert picture.size[0] > 500
    assert (tmp_path / "results/shaker_bode.html").stat().st_size > 10_000
    table = pd.read_csv(tmp_path / "results/shaker_bode.csv")
    assert_allclose(table["frequency [Hz]"].iloc[[0, -1]], [1.0, 10.0], rtol=1e-9)


@pytest.mark.slow(reason="a fifth of a second")
def test_spaced_frequencies_are_used_as_given(bode, tmp_path):
    result = bode("--frequencies", "1:10:4", "--no-page", "--no-picture")
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "results/shaker_bode.csv")
    assert_allclose(table["frequency [Hz]"], [1.0, 4.0, 7.0, 10.0])
