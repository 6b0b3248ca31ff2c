"""Sweeps that measure models without runs, and plots of responses."""

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
from numpy.testing import assert_allclose
from pages import read_page
from turning import ALPHA, THICK, THIN, run_sweep, turning

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


@pytest.mark.slow(reason="many small runs")
def test_curves_connect_runs_in_order_of_the_parameter():
    swept = run_sweep({"speed": [4.0, 1.0, 2.0]}, of="tip")
    plot = swept.plot("tip.y")
    (axes,) = plot.figure.axes
    assert axes.get_title() == "tip.y"
    assert len(axes.lines) == 4 + 1
    assert_allclose(axes.lines[1].get_xdata(), [1.0, 2.0, 4.0])
    assert_allclose(axes.lines[1].get_ydata(), np.sin([0.4, 0.8, 1.6]), atol=2e-3)
    assert axes.get_xscale() == "log"
    assert [x.get_title() for x in swept.plot("tip.x max", "tip.y end").figure.axes] == [
        "tip.x max",
        "tip.y end",
    ]
    with pytest.raises(bd.BeamdaeError, match="no response 'tipp'"):
        swept.plot("tipp")
    with pytest.raises(
        bd.BeamdaeError, match="there is no varied parameter 'radius'; choose from speed"
    ):
        swept.plot(x="radius")
    with pytest.raises(bd.BeamdaeError, match="a map requires two varied parameters, got 1 "):
        swept.map()


@pytest.mark.slow(reason="many small runs")
def test_default_plots_over_two_parameters_have_one_panel_per_column():
    """Three columns had twelve panels, those of all measures."""
    swept = run_sweep({"speed": [4.0, 1.0], "radius": [0.5, 2.0]}, of="tip")
    panels = ["tip.x max", "tip.y max", "tip.angle max"]
    titles = [axis.get_title() for axis in swept.plot().figure.axes]
    # Observed rates are large, but have a panel, too.
    assert [x for x in titles if "dot" not in x] == panels
    assert len(titles) == len({x.rpartition(" ")[0] for x in titles})
    assert len(swept.plot("tip.y").figure.axes) == 4


@pytest.mark.slow(reason="half a second")
def test_two_parameters_give_several_curves_and_a_map(speed_radius_sweep):
    plot = speed_radius_sweep.plot("tip.x max")
    (axes,) = plot.figure.axes
    heights = [line.get_ydata() for line in axes.lines[:3]]
    assert_allclose(heights[0], [0.5] * 3, atol=1e-9)
    assert np.isnan(heights[1]).all()
    # The model rejects the radius 0 at each speed, so that all speeds have a mark.
    assert_allclose(axes.lines[3].get_xdata(), [1.0, 2.0, 4.0])
    names = [text.get_text() for text in plot.figure.legends[0].get_texts()]
    assert names == ["radius = 0.5", "radius = 0", "radius = 2", "did not reach the end time"]
    colored = speed_radius_sweep.map("tip.x max").figure.axes[0].collections[0].get_array()
    assert_allclose(np.ma.filled(colored, -1.0), [[-1.0] * 3, [0.5] * 3, [2.0] * 3], atol=1e-9)


@pytest.mark.slow(reason="many small runs")
def test_values_that_are_not_numbers_are_in_order_of_appearance_and_not_connected():
    swept = run_sweep({"color": ["red", "green"], "section": {"thick": THICK, "thin": THIN}})
    (axes,) = swept.plot("tip.x max", x="section").figure.axes
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["thick", "thin"]
    assert {line.get_linestyle() for line in axes.lines} == {"None"}
    assert swept.map("tip.x max").figure.axes[0].get_xlabel() == "color"


@pytest.mark.slow(reason="many small runs")
def test_geometric_values_have_a_logarithmic_axis_and_few_pairs_are_dots():
    swept = run_sweep([{"speed": x, "radius": 1.0 / x} for x in (0.1, 1.0, 10.0)])
    axes = swept.map("tip.x max").figure.axes[0]
    assert axes.get_xscale() == axes.get_yscale() == "log"
    (dots,) = axes.collections
    assert_allclose(dots.get_offsets()[:, 0], [0.1, 1.0, 10.0])


def test_page_plots_responses_over_a_parameter(speed_radius_sweep, tmp_path):
    page = read_page(speed_radius_sweep.page(tmp_path / "sweep.html"))
    keys = {column["key"]: column["label"] for column in page["columns"]}
    assert keys[page["axes"]["x"]] in ("speed", "radius")
    # The final value of a column that moves is arbitrary.
    assert keys[page["axes"]["y"]] == "tip.x max"
    other = {"speed": "radius", "radius": "speed"}[keys[page["axes"]["x"]]]
    families = [case["family"] for case in page["cases"]]
    assert families == [
        f"{other} = {setting[other]:g}" for setting in speed_radius_sweep.sweep.settings
    ]
    assert [case["series"] for case in page["cases"]] == families
    # A line connects its runs from left to right, in whatever order the values are listed.
    ranks = [case["rank"] for case in page["cases"] if case["family"] == families[0]]
    assert sorted(ranks) == sorted(
        speed_radius_sweep.sweep.settings[k][keys[page["axes"]["x"]]]
        for k in range(len(families))
        if families[k] == families[0]
    )


def test_the_page_has_sliders_and_the_motion_of_cases_that_span_the_parameters(
    speed_radius_sweep, tmp_path
):
    page = read_page(speed_radius_sweep.page(tmp_path / "report.html"))
    sweep = speed_radius_sweep.sweep
    assert [slider["label"] for slider in page["sliders"]] == ["speed", "radius"]
    for slider in page["sliders"]:
        assert slider["values"] == sorted({x[slider["label"]] for x in sweep.settings})
    assert page["sequential"]
    for case, setting in zip(page["cases"], sweep.settings, strict=True):
        values = [x["values"][k] for x, k in zip(page["sliders"], case["at"], strict=True)]
        assert values == [setting["speed"], setting["radius"]]
        assert (case["frames"] is None) == (case["curves"] is None)


def test_regression_constant_responses_have_no_contour_lines():
    """Contours followed the rounding errors."""

    def noise(model):
        return 5.0 + 1e-12 * np.sin(50.0 * model.parameters["speed"] * model.parameters["turns"])

    over = {"speed": [1.0, 2.0, 4.0], "turns": [1, 2, 3]}
    axes = bd.sweep(turning, over, measure={"noise": noise}).map("noise").figure.axes[0]
    (cells,) = axes.collections
    assert np.ptp(cells.get_array()) == 0.0


def test_axes_of_parameters_have_units():
    results = bd.sweep(
        bd.load_model("example:governor"),
        {"torque": [0.5, 0.6], "ratio": [5.0, 6.0]},
        measure={"parts": lambda model: float(len(model.parameters))},
    )
    assert results.plot("parts", x="torque").figure.axes[0].get_xlabel() == "torque [N m]"
    assert results.plot("parts", x="ratio").figure.axes[0].get_xlabel() == "ratio"


@pytest.mark.slow(reason="nine small runs")
def test_regression_maps_and_legends_have_scaled_units():
    """Forces had the axis [N] with 1e5, and legends had no units."""

    @bd.model(t_end=1e-6)
    def pulled(
        stretch=bd.param(0.001, "m", "stretch"), stiffness=bd.param(1e8, "N/m", "stiffness")
    ):
        mech, mass = free_ball(name="mass")
        ground, length = mech.ground.at(-1.0, 0.0), 1.0 - stretch
        spring = mech.add(bd.Spring("spring", ground, mass.point, stiffness, free_length=length))
        mech.observe("pull", spring.force)
        return mech

    over = {"stretch": [1e-3, 2e-3, 4e-3], "stiffness": [1e8, 2e8, 3e8]}
    swept = bd.sweep(pulled, over, integrator=ALPHA)
    name = next(x for x in swept.table if x.startswith("pull") and " max" in x).partition(" [")[0]
    figure = swept.map(name, x="stiffness").figure
    axis, bar_axis = figure.axes
    figure.draw_without_rendering()
    labels = axis.get_xlabel(), axis.get_ylabel(), bar_axis.get_ylabel()
    assert labels == ("stiffness [MN/m]", "stretch [m]", "[MN]")
    (legend,) = swept.plot(name, x="stiffness").figure.legends
    assert [x.get_text() for x in legend.get_texts()] == [f"stretch = 0.00{k} m" for k in (1, 2, 4)]
