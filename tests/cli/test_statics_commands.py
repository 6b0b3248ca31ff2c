"""`beamdae static` and `beamdae buckling`: tables, options and messages."""

import itertools
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed
from matplotlib.image import imread
from model_texts import OSCILLATOR, STRUT, TRUSS, VAN_DER_POL
from numpy.testing import assert_allclose

TRUSSES = (
    TRUSS
    + '''

calls = []


@bd.model(t_end=1.0)
def interrupted(load=1.0):
    calls.append(load)
    if len(calls) == 30:
        raise KeyboardInterrupt
    return truss(load=load)


@bd.model(t_end=1.0)
def falling():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.add(bd.PointMass("stone", 1.0, at=(0.0, 0.0)))
    return mech


@bd.model(t_end=1.0)
def low_truss(height=200.0):
    """Truss whose crown has the height `height` [mm]."""
    return truss(rise=height / 1000.0)
'''
)


@pytest.fixture
def static(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("truss.py").write_text(TRUSSES)

    def run(*arguments, model="truss"):
        return invoke("static", "truss.py", "--model", model, *arguments)

    return run


def test_an_interrupted_path_is_written(static):
    result = static("--over", "load", "--to", "2", "--step", "0.05", model="interrupted")
    assert result.exit_code == 130
    assert len(pd.read_csv("results/interrupted_static.csv")) > 1
    assert read_metadata("interrupted")["status"] == "interrupted"
    assert "interrupted" in result.stderr
    assert "the results so far are in results/interrupted_static.csv" in result.stderr
    assert Path("results/interrupted_static.png").exists()


def read_metadata(name="truss"):
    return json.loads(Path(f"results/{name}_static.json").read_text())


@pytest.mark.slow(reason="a fifth of a second")
def test_a_path_is_written_and_printed(static):
    result = static("--to", "crown.y=0", "--to", "crown.y=-0.25")
    assert result.exit_code == 0, result.output
    assert "limit point at 3.019147, crown.y moves most; limit point at -3.019147" in result.stdout
    assert "equilibrium      stable" in result.stdout
    table = pd.read_csv("results/truss_static.csv")
    assert table["crown.y [m]"].iloc[-1] == -0.25
    # The truss is .2 m high.
    assert np.abs(table["crown.y [m]"]).min() < 1e-15
    assert read_metadata()["critical points"][0]["kind"] == "limit point"
    picture = imread("results/truss_static.png")
    assert picture.std() > 0.01


@pytest.mark.slow(reason="half a second")
def test_an_incomplete_path_is_written_with_its_reason(static):
    result = static("--to", "4", "--control", "load")
    assert result.exit_code == 1
    assert "failed: " in result.stderr
    assert "last converged load factor: 3.019" in result.stderr
    assert read_metadata()["status"] == "failed"
    assert set(pd.read_csv("results/truss_static.csv")["status"]) == {"failed"}
    assert Path("results/truss_static.png").exists()


@pytest.mark.slow(reason="a fifth of a second")
def test_paths_pass_limit_points_by_default(static):
    result = static("--to", "4", "--no-page", "--no-picture")
    assert result.exit_code == 0, result.output
    # The path by the load, which ends at the limit point, is replaced.
    assert "Newton's method diverges" not in result.stderr
    kinds = [point["kind"] for point in read_metadata()["critical points"]]
    assert kinds == ["limit point", "limit point"]
    table = pd.read_csv("results/truss_static.csv")
    assert table["crown.y [m]"].iloc[-1] < -0.2
    assert table["load factor [-]"].min() == pytest.approx(-3.019, abs=1e-3)


@pytest.mark.slow(reason="takes more than half a second")
def test_branch_switches_are_made_in_turn(static):
    arguments = ("--set", "rise=3", "--to", "crown.y=-3.5", "--step", "0.3")
    once = static(*arguments, "--switch", "1")
    assert once.exit_code == 1
    assert "the path is closed" in once.stderr
    twice = static(*arguments, "--switch", "1", "--switch", "1")
    assert twice.exit_code == 0, twice.output
    assert read_metadata()["settings"]["switch"] == [1, 1]


@pytest.mark.slow(reason="one second")
def test_a_model_without_equilibrium_fails_with_the_coordinate(static):
    result = static(model="falling")
    assert result.exit_code == 1
    assert "stone.y: no equilibrium was found under the loads at t = 0 s" in result.stderr
    assert read_metadata("falling")["load factor"] == 0.0


@pytest.mark.slow(reason="half a second")
def test_targets_and_steps_with_units(static):
    result = static("--to", "crown.y=150mm", "--to", "crown.y=10cm", "--step", "20mm")
    assert result.exit_code == 0
    heights = pd.read_csv("results/truss_static.csv")["crown.y [m]"].to_numpy()
    assert {0.15, 0.1} <= set(heights)
    assert np.max(np.abs(np.diff(heights))) <= 0.02 * (1 + 1e-12)
    assert static("--to", "50%").exit_code == 0
    factors = pd.read_csv("results/truss_static.csv")["load factor [-]"]
    assert factors.iloc[-1] == 0.5


@pytest.mark.slow(reason="half a second")
def test_another_quantity_varies(static):
    result = static("--over", "load", "--from", "1", "--to", "2", "--step", "0.25")
    assert result.exit_code == 0, result.output
    table = pd.read_csv("results/truss_static.csv")
    assert table["load"].tolist() == [1.0, 1.25, 1.5, 1.75, 2.0]
    assert read_metadata()["settings"]["over"] == "load"
    result = static("--over", "height", "--to", "2")
    assert result.exit_code == 2
    assert "--over must be 't' or the name" in result.stderr


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_values_of_a_parameter_are_converted_to_its_unit(static):
    """A text with a unit became a value in SI units: 0.25 mm for a height of 0.25 m."""
    result = static("--over", "height", "--to", "0.25m", "--step", "1cm", model="low_truss")
    assert result.exit_code == 0, result.output
    table = pd.read_csv("results/low_truss_static.csv")
    heights = table["height [mm]"].to_numpy()
    assert heights[[0, -1]].tolist() == [200.0, 250.0]
    assert np.max(np.diff(heights)) <= 10.0 * (1 + 1e-12)
    # The force of 1 N lowers the crown by less than 0.01 m.
    assert table["crown.y [m]"].iloc[-1] == pytest.approx(0.25, abs=0.01)
    result = static("--over", "height", "--to", "3s", model="low_truss")
    assert result.exit_code == 2
    assert "--to height=3s: the unit s measures another quantity" in result.stderr


@pytest.fixture
def buckling(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("column.py").write_text(STRUT, encoding="utf-8")
    return lambda *arguments: invoke("buckling", "column.py", *arguments)


@pytest.mark.slow(reason="half a second and more")
def test_a_table_and_a_picture_are_written(buckling):
    result = buckling("-n", "2", "--set", "height=0.001")
    assert result.exit_code == 0, result.output
    assert "2.467" in result.stdout
    assert "error" in result.stdout
    assert "loads  press" in result.stdout
    table = pd.read_csv("results/column_buckling.csv")
    assert table["load factor [-]"].tolist() == pytest.approx([2.467, 22.207], rel=1e-3)
    assert Path("results/column_buckling.png").stat().st_size > 1000


@pytest.mark.slow(reason="a quarter of a second")
def test_json_contains_the_factors(buckling):
    result = buckling("-n", "1", "--json")
    document = json.loads(result.stdout)
    assert document["loads"] == ["press"]
    assert document["modes"][0]["load factor [-]"] == pytest.approx(2.467, rel=1e-3)


# `beamdae periodic` and `beamdae response`: tables, options and messages.


@pytest.fixture
def periodic(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(VAN_DER_POL, encoding="utf-8")
    return lambda *arguments: invoke("periodic", "model.py", *arguments)


@pytest.mark.slow(reason="half a second and more")
def test_a_self_excited_motion_is_written(periodic):
    result = periodic()
    assert result.exit_code == 0, result.output
    period = float(re.search(r"period +(\S+) s", result.stdout)[1])
    assert period == pytest.approx(6.6632869, rel=1e-7), result.stdout
    table = pd.read_csv("results/oscillator_periodic.csv")
    assert table["t [s]"].iloc[-1] == pytest.approx(6.6632869, rel=1e-7)
    assert Path("results/oscillator_periodic.png").stat().st_size > 1000


@pytest.mark.slow(reason="a quarter of a second")
def test_json_of_a_forced_motion(periodic):
    # With growth = 0, the oscillator is linear and undamped.
    options = ["--set", "force=1.0", "--set", "growth=0.0", "--period", "4", "--rtol", "1e-6"]
    document = json.loads(periodic(*options, "--t-start", "8s", "--json").stdout)
    times = pd.read_csv("results/oscillator_periodic.csv")["t [s]"]
    assert_allclose(times.iloc[[0, -1]], [8.0, 12.0], rtol=1e-12)
    assert document["status"] == "ok"
    assert document["stable"]
    half = document["observed"]["mass.x [m]"]["half range"]
    assert half == pytest.approx(1.0 / ((0.5 * np.pi) ** 2 - 1.0), rel=1e-3)
    assert np.hypot(*document["multipliers"][0]) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow(reason="a quarter of a second")
def test_a_failed_search_exits_with_1(periodic):
    # With negative growth, all motions decay.
    result = periodic("--set", "growth=-1.0", "--period-guess", "6")
    assert result.exit_code == 1
    assert "failed: " in result.stderr


def amplitude(rate, force=0.1):
    """Return the amplitude of x'' + 0.4 x' + 4 x = force sin(rate t)."""
    return force / np.hypot(4.0 - rate**2, 0.4 * rate)


@pytest.fixture
def response(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("oscillator.py").write_text(OSCILLATOR, encoding="utf-8")
    return lambda *arguments: invoke("response", "oscillator.py", *arguments)


@pytest.mark.slow(reason="half a second and more")
def test_one_period_is_written(response, monkeypatch):
    clock = itertools.count(0.0, 11.0)
    monkeypatch.setattr("beamdae.cli.progress.monotonic", lambda: next(clock))
    result = response("--over", "frequency=0.26:0.36", "--rtol", "1e-6")
    assert result.exit_code == 0, result.output
    table = pd.read_csv("results/oscillator_response.csv")
    rates = 2.0 * np.pi * table["frequency"]
    assert_allclose(table["bob.x half range [m]"], amplitude(rates), rtol=1e-4)
    assert table["stable"].all()
    assert "reached the end of the range" in result.stdout
    # Lines are printed after every ten seconds.
    first, *_, last = (x for x in result.stderr.splitlines() if "left" in x)
    assert first == "frequency = 0.26 Hz: 1 point, -:-- left"
    assert last == f"frequency = 0.36 Hz: {len(table)} points, 0:00 left"
    assert "peak" in result.stdout
    assert "[Hz]" in result.stdout
    assert Path("results/oscillator_response.png").stat().st_size > 1000
    assert Path("results/oscillator_response.html").stat().st_size > 10_000


@pytest.mark.slow(reason="a curve")
def test_json_of_an_angular_frequency(response):
    text = OSCILLATOR.replace("frequency=0.2", 'frequency=bd.param(0.2, "rad/s")')
    Path("oscillator.py").write_text(text, encoding="utf-8")
    options = ("--over", "frequency=1.9:2.1", "--set", "angular=True", "--no-page")
    result = response(*options, "--json")
    document = json.loads(result.stdout)
    assert document["status"] == "ok"
    assert not Path("results/oscillator_response.html").exists()
    assert document["folds"] == []
    first = document["points"][0]
    assert first["period [s]"] == pytest.approx(2.0 * np.pi / 1.9)
    assert first["bob.x half range [m]"] == pytest.approx(amplitude(1.9), rel=1e-5)


@pytest.mark.slow(reason="a curve")
def test_a_constant_period_belongs_to_another_parameter(response):
    result = response("--over", "force=0.1N:200mN", "--period", "5", "--json")
    points = json.loads(result.stdout)["points"]
    expected = [amplitude(0.4 * np.pi, point["force"]) for point in points]
    assert_allclose([point["bob.x half range [m]"] for point in points], expected, rtol=1e-5)


@pytest.mark.slow(reason="half a second and more")
def test_a_curve_that_ends_early_is_a_failure_with_partial_results(response):
    result = response("--over", "frequency=0.26:0.36", "--rtol", "1e-6", "--max-points", "2")
    assert result.exit_code == 1
    assert "failed: stopped at the maximum of 2 points" in result.stderr
    # Curves without a peak had no amplitudes on the screen.
    assert re.search(r"bob\.x \[m\] .* no$", result.stdout, re.MULTILINE)
    assert len(pd.read_csv("results/oscillator_response.csv")) == 2


@pytest.mark.slow(reason="two analyses")
def test_columns_of_the_picture_can_be_chosen(response):
    arguments = ["--plot", "bob.x", "--plot", "bob.x_dot", "--no-page", "--settle", "1"]
    over = ["--over", "frequency=0.26:0.36", "--max-points", "2"]
    for command in (["response", *over], ["periodic", "--period", "5"]):
        result = invoke(command[0], "oscillator.py", *command[1:], *arguments)
        assert result.exit_code in (0, 1), result.output
        assert "no observed column" not in result.output
        assert Path(f"results/oscillator_{command[0]}.png").stat().st_size > 1000


DUFFING = """
import beamdae as bd


@bd.model(t_end=1.0)
def duffing(frequency=bd.param(10.0, "Hz")):
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))

    def spring(mass, t):
        x, v = mass.position[0], mass.velocity[0]
        return (-4000.0 * x - 2e7 * x**3 - 4.0 * v, 0.0)

    mech.add(bd.ForceLaw("spring", mass.point, spring))
    mech.add(bd.Force("force", mass.point, (bd.sine(4.0, frequency=frequency), 0.0)))
    mech.observe("mass", mass.point)
    return mech
"""


@pytest.mark.slow(reason="a curve")
def test_regression_critical_points_have_kinds_and_units(tmp_path, monkeypatch):
    """Only folds were printed, without a unit; period doublings were in Python only."""
    monkeypatch.chdir(tmp_path)
    Path("duffing.py").write_text(DUFFING, encoding="utf-8")
    options = ("response", "duffing.py", "--over", "frequency=11:13.5", "--rtol", "1e-7")
    result = succeed(*options, "--no-page", "--no-picture")
    line = next(x for x in result.stdout.splitlines() if x.startswith("critical points"))
    first, second = line.removeprefix("critical points").split(";")
    assert first.split()[:2] == second.split()[:2] == ["fold", "at"]
    assert first.split()[3] == second.split()[3] == "Hz"
    assert float(first.split()[2]) > float(second.split()[2]) > 11.0
