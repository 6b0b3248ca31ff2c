"""Response plots of sweeps, and the page with their runs over each other."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from turning import THICK, THIN, run_sweep

import beamdae as bd
from beamdae.report.page.page_file import write_page
from beamdae.studies.study_page import create_study_page
from beamdae.studies.sweeps.response_plots import ParameterScale
from beamdae.studies.sweeps.responses import MEASURES
from beamdae.studies.sweeps.sweep_results import create_sweep_page


@pytest.fixture(scope="module")
def found():
    return run_sweep({"speed": [4.0, 1.0, 2.0], "radius": [0.5, 0.0, 2.0]})


@pytest.mark.slow(reason="many small runs")
def test_curves_are_joined_in_the_order_of_the_parameter():
    found = run_sweep({"speed": [4.0, 1.0, 2.0]}, of="tip")
    plot = found.plot("tip.y")
    (axes,) = plot.figure.axes
    assert axes.get_title() == "tip.y"
    assert len(axes.lines) == len(MEASURES) + 1
    assert_allclose(axes.lines[1].get_xdata(), [1.0, 2.0, 4.0])
    assert_allclose(axes.lines[1].get_ydata(), np.sin([0.4, 0.8, 1.6]), atol=2e-3)
    assert axes.get_xscale() == "log"
    assert [x.get_title() for x in found.plot("tip.x max", "tip.y end").figure.axes] == [
        "tip.x max",
        "tip.y end",
    ]
    with pytest.raises(bd.BeamdaeError, match="no response 'tipp'"):
        found.plot("tipp")
    with pytest.raises(bd.BeamdaeError, match="no parameter 'radius' varies; choose speed"):
        found.plot(x="radius")
    with pytest.raises(bd.BeamdaeError, match="a map needs two varied parameters, got 1 "):
        found.map()


def test_two_parameters_are_a_family_of_curves_and_a_map(found):
    plot = found.plot("tip.x max")
    (axes,) = plot.figure.axes
    heights = [line.get_ydata() for line in axes.lines[:3]]
    assert_allclose(heights[0], [0.5] * 3, atol=1e-9)
    assert np.isnan(heights[1]).all()
    # Marks at all speeds, for a radius of 0 is refused at each.
    assert_allclose(axes.lines[3].get_xdata(), [1.0, 2.0, 4.0])
    names = [text.get_text() for text in plot.figure.legends[0].get_texts()]
    assert names == ["radius=0.5", "radius=0", "radius=2", "did not reach its end"]
    colored = found.map("tip.x max").figure.axes[0].collections[0].get_array()
    assert_allclose(np.ma.filled(colored, -1.0), [[-1.0] * 3, [0.5] * 3, [2.0] * 3], atol=1e-9)


@pytest.mark.slow(reason="many small runs")
def test_what_is_no_number_has_its_place_in_order_and_is_not_joined():
    found = run_sweep({"color": ["red", "green"], "section": {"thick": THICK, "thin": THIN}})
    (axes,) = found.plot("tip.x max", x="section").figure.axes
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["thick", "thin"]
    assert {line.get_linestyle() for line in axes.lines} == {"None"}
    assert found.map("tip.x max").figure.axes[0].get_xlabel() == "color"


@pytest.mark.slow(reason="many small runs")
def test_ratios_make_a_logarithmic_axis_and_few_pairs_are_dots():
    found = run_sweep([{"speed": x, "radius": 1.0 / x} for x in (0.1, 1.0, 10.0)])
    assert ParameterScale.of(found.table, "speed").log
    assert_allclose(
        ParameterScale.of(found.table, "speed").cell_edges(), 10.0 ** np.arange(-1.5, 2.0)
    )
    (dots,) = found.map("tip.x max").figure.axes[0].collections
    assert_allclose(dots.get_offsets()[:, 0], [0.1, 1.0, 10.0])


def test_pages_lay_the_runs_over_each_other(found, tmp_path):
    assert found.page(tmp_path / "report.html").stat().st_size > 10_000
    shown = create_study_page(found.results, found.table[["speed", "radius", "tip.x max [m]"]])
    assert [group["label"] for group in shown["groups"]] == ["turning_sweep"]
    assert [case["label"] for case in shown["cases"]][:2] == [
        "speed=4, radius=0.5",
        "speed=4, radius=0",
    ]
    columns = {c["label"]: c for c in shown["columns"]}
    assert columns["tip.x max"]["unit"] == "m"
    assert columns["tip.x max"]["kind"] == "number"
    assert shown["cases"][0]["values"][columns["tip.x max"]["key"]] == pytest.approx(0.5)
    assert write_page(tmp_path / "again.html", shown).is_file()


def test_pages_draw_what_is_told_over_a_parameter(found):
    shown = create_sweep_page(found)
    keys = {column["key"]: column["label"] for column in shown["columns"]}
    assert keys[shown["axes"]["x"]] in ("speed", "radius")
    assert shown["axes"]["y"] in keys
    other = {"speed": "radius", "radius": "speed"}[keys[shown["axes"]["x"]]]
    families = [case["family"] for case in shown["cases"]]
    assert families == [f"{other}={told[other]:g}" for told in found.sweep.settings]
    assert [case["series"] for case in shown["cases"]] == families
    # A line goes from the left to the right, however values are given.
    first = [case["rank"] for case in shown["cases"] if case["family"] == families[0]]
    assert sorted(first) == sorted(
        found.sweep.settings[k][keys[shown["axes"]["x"]]]
        for k in range(len(families))
        if families[k] == families[0]
    )
