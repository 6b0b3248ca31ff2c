"""Response plots of sweeps, and the page with their runs over each other."""

import numpy as np
import pytest
from mechanisms import free_ball
from numpy.testing import assert_allclose
from pages import read_page
from turning import ALPHA, THICK, THIN, run_sweep, turning

import beamdae as bd


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
