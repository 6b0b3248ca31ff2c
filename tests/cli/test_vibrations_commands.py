"""`beamdae modes` and `beamdae bode`: tables, options and messages."""

import json

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed
from model_texts import CROSS, SHAKER
from numpy.testing import assert_allclose
from PIL import Image


@pytest.fixture
def modes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cross.py").write_text(CROSS)
    return lambda *arguments: invoke("modes", "cross.py", *arguments)


@pytest.mark.slow(reason="draws pictures")
def test_modes_writes_a_table_and_pictures(modes, tmp_path):
    result = modes("--set", "stiffness=32", "-n", "2", "--about", "equilibrium", "--animate", "2")
    assert result.exit_code == 0
    table = pd.read_csv(tmp_path / "results/cross_modes.csv")
    assert_allclose(table["frequency [Hz]"], [0.6366198, 1.0065842], rtol=1e-6)
    assert list(table["moves"]) == ["bob 100 %"] * 2
    assert "vibration" in result.stdout
    with Image.open(tmp_path / "results/cross_mode_2.gif") as animation:
        assert animation.n_frames == 32
    with Image.open(tmp_path / "results/cross_modes.png") as picture:
        assert picture.size[0] > 500


def test_warnings_are_printed_once(modes):
    result = modes("--set", "weight=9.81", "--no-page", "--no-picture")
    assert result.exit_code == 0
    assert result.output.count("warning: ") == result.output.count("not an equilibrium") == 1


@pytest.mark.slow(reason="draws a picture")
def test_several_speeds_make_a_campbell_diagram(modes, tmp_path):
    result = modes("--speed", "0", "--speed", "5.5", "-n", "2")
    assert result.exit_code == 0
    table = pd.read_csv(tmp_path / "results/cross_modes.csv")
    assert list(table["speed [rad/s]"]) == [0.0, 5.5]
    # Between the roots of 50 / 2 and 80 / 2.
    assert max(table["growth rate 1 [1/s]"][1], table["growth rate 2 [1/s]"][1]) > 0.1
    assert "warning: at 5.5 rad/s, the state is unstable" in result.stdout
    assert (tmp_path / "results/cross_modes.png").exists()
    assert (tmp_path / "results/cross_modes.html").stat().st_size > 10_000


@pytest.mark.slow(reason="half a second and more")
def test_regression_campbell_diagrams_print_and_write_their_resonances(modes, tmp_path):
    """They were only on the page; speeds had three digits, such as 1.26e+03 rad/s for 12000 rpm."""
    speeds = "--speed", "0:120rpm:3", "--multiple", "2", "--multiple", "1", "--no-page"
    result = modes(*speeds, "--no-picture", "-n", "2", "--json")
    data = json.loads(result.stdout)
    table = pd.read_csv(tmp_path / "results/cross_resonances.csv")
    assert table.to_dict("records") == data["resonances"]
    assert set(table["multiple"]) <= {1, 2}
    # The mass of 2 kg on springs of 50 N/m in the rotating frame: (w - W) (w + W) ... = 0.
    assert_allclose(2.0 * np.pi * table["frequency [Hz]"], table["multiple"] * table.iloc[:, 0])
    assert len(table) > 0
    shown = modes(*speeds, "--no-picture", "-n", "2").stdout
    assert f"{table.iloc[0, 0] * 30.0 / np.pi:.5g}" in shown


def test_an_immobile_model_has_an_empty_table(modes, tmp_path):
    result = modes("--set", "locked=True")
    assert result.exit_code == 0
    assert "there are no modes because joints and drivers fix every coordinate" in result.stdout
    assert len(pd.read_csv(tmp_path / "results/cross_modes.csv")) == 0


OVERDAMPED = """
import beamdae as bd


@bd.model(t_end=1.0)
def strip():
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.02, 0.01, damping=1e-3)
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (0.5, 0.0)), section, elements=6))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    return mech
"""


def test_regression_overdamped_vibrations_of_a_beam_are_one_row(tmp_path, monkeypatch):
    """Nine of ten rows were decays at 1000 1/s, the reciprocal of the damping time."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "strip.py").write_text(OVERDAMPED)
    result = succeed("modes", "strip.py", "--no-page", "--no-picture")
    rows = [line.split() for line in result.stdout.splitlines() if "strip 100 %" in line]
    assert [row[0] for row in rows] == ["1", "2"]
    assert rows[1][:3] == ["2", "to", "10"]
    assert "-1000" in rows[1]
    assert len(pd.read_csv(tmp_path / "results/strip_modes.csv")) == 10


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
