"""Response plots of sweeps, and the page with their runs over each other."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from turning import ALPHA, THICK, THIN, run_sweep

import beamdae as bd
from beamdae.report.page.page_file import write_page
from beamdae.studies.column_measures import MEASURES
from beamdae.studies.study_page import create_study_page
from beamdae.studies.sweeps.parameter_grid import ParameterGrid
from beamdae.studies.sweeps.response_plots import ParameterScale, _draw_map, drop_constant
from beamdae.studies.sweeps.sweep_results import create_sweep_page


@pytest.fixture(scope="module")
def speed_radius_sweep():
    return run_sweep({"speed": [4.0, 1.0, 2.0], "radius": [0.5, 0.0, 2.0]})


@pytest.mark.slow(reason="many small runs")
def test_curves_connect_runs_in_order_of_the_parameter():
    swept = run_sweep({"speed": [4.0, 1.0, 2.0]}, of="tip")
    plot = swept.plot("tip.y")
    (axes,) = plot.figure.axes
    assert axes.get_title() == "tip.y"
    assert len(axes.lines) == len(MEASURES) + 1
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
    assert ParameterScale.of(swept.table, "speed").log
    assert_allclose(
        ParameterScale.of(swept.table, "speed").cell_edges(), 10.0 ** np.arange(-1.5, 2.0)
    )
    (dots,) = swept.map("tip.x max").figure.axes[0].collections
    assert_allclose(dots.get_offsets()[:, 0], [0.1, 1.0, 10.0])


def test_page_has_one_group_of_all_runs(speed_radius_sweep, tmp_path):
    assert speed_radius_sweep.page(tmp_path / "report.html").stat().st_size > 10_000
    page = create_study_page(
        speed_radius_sweep.results, speed_radius_sweep.table[["speed", "radius", "tip.x max [m]"]]
    )
    assert [group["label"] for group in page["groups"]] == ["turning_sweep"]
    assert [case["label"] for case in page["cases"]][:2] == [
        "speed=4, radius=0.5",
        "speed=4, radius=0",
    ]
    columns = {c["label"]: c for c in page["columns"]}
    assert columns["tip.x max"]["unit"] == "m"
    assert columns["tip.x max"]["kind"] == "number"
    assert page["cases"][0]["values"][columns["tip.x max"]["key"]] == pytest.approx(0.5)
    assert write_page(tmp_path / "again.html", page).is_file()


def test_page_plots_responses_over_a_parameter(speed_radius_sweep):
    page = create_sweep_page(speed_radius_sweep)
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


def test_the_page_has_sliders_a_map_and_the_motion_of_cases_that_span_the_parameters(
    speed_radius_sweep,
):
    page = create_sweep_page(speed_radius_sweep)
    sweep = speed_radius_sweep.sweep
    assert [slider["label"] for slider in page["sliders"]] == ["speed", "radius"]
    for slider in page["sliders"]:
        assert slider["values"] == sorted({x[slider["label"]] for x in sweep.settings})
    assert sorted(page["map"]) == [0, 1]
    assert page["sequential"]
    for case, setting in zip(page["cases"], sweep.settings, strict=True):
        values = [x["values"][k] for x, k in zip(page["sliders"], case["at"], strict=True)]
        assert values == [setting["speed"], setting["radius"]]
        assert (case["frames"] is None) == (case["curves"] is None)


@pytest.mark.parametrize(
    ("counts", "expected"),
    [((2000,), (25,)), ((50, 40), (5, 5)), ((1000, 2), (12, 2)), ((10,) * 3, (2, 3, 4))],
)
def test_samples_span_the_parameters(counts, expected):
    settings = [dict(enumerate(k)) for k in np.ndindex(counts)]
    grid = ParameterGrid.of(settings, list(range(len(counts))))
    positions = grid.positions[sorted(grid.sample(25))]
    assert len(positions) <= 25
    found = sorted(len(np.unique(x)) for x in positions.T)
    assert found == sorted(expected)
    assert_allclose(positions.min(axis=0), 0)
    assert_allclose(positions.max(axis=0), np.array(counts) - 1)


def test_combinations_without_a_grid_are_a_list():
    settings = [{"a": 1, "b": 1}, {"a": 2, "b": 2}, {"a": 3, "b": 1}]
    grid = ParameterGrid.of(settings, ["a", "b"])
    assert [axis.name for axis in grid.axes] == ["case"]
    assert grid.positions.tolist() == [[0], [1], [2]]


def test_axes_of_parameters_have_units():
    results = bd.sweep(
        bd.load_model("example:governor"),
        {"torque": [0.5, 0.6], "ratio": [5.0, 6.0]},
        measure={"parts": lambda model: float(len(model.parameters))},
    )
    assert results.plot("parts", x="torque").figure.axes[0].get_xlabel() == "torque [N m]"
    assert results.plot("parts", x="ratio").figure.axes[0].get_xlabel() == "ratio"


@pytest.mark.slow(reason="one second")
def test_constant_responses_are_not_plotted_by_default():
    swept = run_sweep({"speed": [1.0, 2.0, 4.0], "radius": [0.5, 2.0]})
    table = swept.table.assign(**{"tip.x max [m]": 3.0})
    panels = swept.panels("tip.x max", "tip.x end")
    (panel,) = drop_constant(swept.sweep, table, panels)
    assert list(panel.lines.values()) == ["tip.x end [m]"]
    # All panels, if none varies.
    assert len(drop_constant(swept.sweep, table, panels[:1])) == 1


@pytest.mark.parametrize(
    ("values", "is_exact"), [((2000, 3000, 4000), True), ((2, 8 / 3, 4), False)]
)
def test_ticks_are_values_with_few_digits_or_round_numbers(values, is_exact):
    scale = ParameterScale.of(pd.DataFrame({"speed": [float(x) for x in values]}), "speed")
    axes = Figure().add_subplot()
    axes.set_xlim(values[0], values[-1])
    scale.format_axis(axes, "x")
    ticks = axes.get_xticks()
    assert (len(ticks) == 3 and np.allclose(ticks, values)) == is_exact
    assert not np.isclose(ticks, 8 / 3).any()


@pytest.mark.slow(reason="nine small runs")
def test_regression_maps_and_legends_have_scaled_units():
    """Forces had the axis [N] with 1e5, lengths were 0.003 [m], and legends had no units."""

    @bd.model(t_end=1e-6)
    def pulled(
        stretch=bd.param(0.001, "m", "stretch"), stiffness=bd.param(1e8, "N/m", "stiffness")
    ):
        mech = bd.Mechanism()
        mass = mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0)))
        ground, length = mech.ground.at(-1.0, 0.0), 1.0 - stretch
        spring = mech.add(
            bd.SpringDamper("spring", ground, mass.point, stiffness, free_length=length)
        )
        mech.observe("pull", spring.force)
        return mech

    over = {"stretch": [1e-3, 2e-3, 4e-3], "stiffness": [1e8, 2e8, 3e8]}
    swept = bd.sweep(pulled, over, integrator=ALPHA)
    name = next(x for x in swept.table if x.startswith("pull") and " max" in x).partition(" [")[0]
    figure = swept.map(name, x="stiffness").figure
    axis, bar_axis = figure.axes
    figure.draw_without_rendering()
    labels = axis.get_xlabel(), axis.get_ylabel(), bar_axis.get_ylabel()
    assert labels == ("stiffness [MN/m]", "stretch [mm]", "[MN]")
    assert [x.get_text() for x in axis.get_xticklabels()] == ["100", "200", "300"]
    assert [x.get_text() for x in axis.get_yticklabels()] == ["1", "2", "4"]
    (legend,) = swept.plot(name, x="stiffness").figure.legends
    assert [x.get_text() for x in legend.get_texts()] == [f"stretch = {k} mm" for k in (1, 2, 4)]


@pytest.mark.parametrize(("step", "n_collections"), [(0.0, 1), (1.0, 2)])
def test_regression_maps_have_no_contour_lines_of_rounding_errors(step, n_collections):
    x, y = np.repeat([1.0, 2.0, 3.0], 3), np.tile([1.0, 2.0, 3.0], 3)
    table = pd.DataFrame({"x": x, "y": y})
    axes = Figure().add_subplot()
    noise = 1e-12 * np.random.default_rng(0).normal(size=9)
    values = noise + step * (x > 2.0) + 5.0 * (step == 0.0)
    _draw_map(axes, ParameterScale.of(table, "x"), ParameterScale.of(table, "y"), values, "[N]")
    assert len(axes.collections) == n_collections
    if step == 0.0:
        assert np.ptp(axes.collections[0].get_array()) == 0.0
    else:
        # A single line between the columns.
        paths = axes.collections[1].get_paths()
        points = np.vstack([path.vertices for path in paths])
        assert points[:, 0].min() > 1.99
