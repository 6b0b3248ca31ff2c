"""Pages of equilibria, modes, buckling and periodic motions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import visible_labels

import beamdae as bd
from beamdae.report.analysis_pages import build_modes_page, build_path_page, build_periodic_page


@pytest.fixture(scope="module")
def truss():
    mech = bd.Mechanism()
    crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, 0.2)))
    mech.add(bd.Spring("left", mech.ground.at(-1.0, 0.0), crown.point, 1000.0))
    mech.add(bd.Spring("right", mech.ground.at(1.0, 0.0), crown.point, 1000.0))
    mech.add(bd.Force("press", crown.point, (0.0, -1.0)))
    mech.observe("crown", crown.point)
    return mech


@pytest.fixture(scope="module")
def path(truss):
    return bd.equilibrium(truss, to={"crown.y": 0.0})


@pytest.fixture(scope="module")
def column():
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.01)
    line = bd.Line((0.0, 0.0), (0.0, 1.0))
    beam = mech.add(bd.Beam("column", line, section, elements=2))
    mech.add(bd.Weld("foot", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("weight", beam.end, (0.0, -1.0)))
    return mech


def test_the_page_of_a_path_has_its_points_and_critical_points(path, tmp_path):
    page = build_path_page(path, "truss")
    assert page["time"] == {"name": "point", "unit": ""}
    assert (page["portrait"]["x"], page["portrait"]["y"]) == ("crown.y [m]", "load factor [-]")
    assert [mark["label"] for mark in page["portrait"]["marks"]] == ["limit point"]
    curves = page["cases"][0]["curves"]
    assert_allclose(curves["t"], np.arange(len(path.q)))
    assert_allclose(curves["observed"]["load factor [-]"], path.factors[:, -1])
    frames = page["groups"][0]["frames"]
    assert len(frames["t"]) == len(path.q)
    tables = {table["title"]: table for table in page["tables"]}
    assert tables["Critical points"]["rows"][0][:2] == ["limit point", "3.019147"]
    assert path.page(tmp_path / "path.html").stat().st_size > 10_000


def test_the_page_of_modes_has_a_motion_for_each(column, tmp_path):
    modes = bd.modes(column, n=3)
    page = build_modes_page(modes, "column")
    assert [case["label"] for case in page["cases"]] == [modes.describe(k) for k in range(3)]
    assert_allclose([x["values"]["frequency [Hz]"] for x in page["cases"]], modes.frequencies)
    for case in page["cases"]:
        (beam,) = (x for x in case["frames"]["bodies"] if x["kind"] == "beam")
        x = np.array(beam["x"])
        # One period that starts and ends at rest; all modes have the same amplitude.
        assert_allclose(x[0], x[-1], atol=1e-4)
        assert np.abs(x).max() == pytest.approx(0.12, rel=0.02)
    assert modes.page(tmp_path / "modes.html").is_file()


def test_the_page_of_buckling_lists_the_factors(column, tmp_path):
    buckling = bd.buckling(column, 2)
    page = build_modes_page(buckling, "column")
    assert_allclose([x["values"]["load factor [-]"] for x in page["cases"]], buckling.factors)
    assert buckling.page(tmp_path / "buckling.html").is_file()


@pytest.fixture(scope="module")
def shaken():
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0)))
    mech.add(bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), mass.point, 400.0, 4.0))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
    mech.add(bd.Force("shake", mass.point, (bd.sine(20.0, 2.0), 0.0)))
    mech.observe("mass", mass.point)
    return bd.periodic(mech, 0.5)


def test_the_page_of_a_periodic_motion_has_its_stability_first(shaken, tmp_path):
    page = build_periodic_page(shaken, "shaken")
    assert page["subtitle"] == "repeats after one period; stable"
    titles = [table["title"] for table in page["tables"] if table.get("section") != "solver"]
    assert titles == ["Periodic motion", "Amplitudes"]
    assert shaken.page(tmp_path / "periodic.html").is_file()


def test_the_page_of_a_path_in_a_browser(path, show):
    tab = show(build_path_page(path, "truss"))
    assert tab.locator("[data-chart=portrait] .mark").count() == 1
    assert tab.locator("[data-chart=portrait] .time-dot").count() == 1
    start = float(tab.locator(".time-dot").get_attribute("cx"))
    tab.locator("#frame").fill(str(len(path.q) - 1))
    assert tab.inner_text("#time") == f"point = {len(path.q) - 1}"
    # The crown moves down, to the left in the chart.
    assert float(tab.locator(".time-dot").get_attribute("cx")) < start - 100.0
    # The guided coordinate stays zero.
    constant = tab.locator("[data-panel=observed] optgroup option").all_inner_texts()
    assert "crown.x [m]" in constant
    tab.get_by_label("x axis of the curve").select_option("load factor [-]")
    assert tab.locator("[data-chart=portrait] .title").first.text_content() == "load factor [-]"


def test_the_page_of_modes_in_a_browser(column, show):
    tab = show(build_modes_page(bd.modes(column, n=3), "column"))
    assert tab.inner_text("#cases-title") == "All modes"
    assert not tab.locator("#curves").is_visible()
    shown = tab.inner_text("#shown")
    assert shown == visible_labels(tab)[0]
    tab.locator("#table tbody tr").nth(2).locator("td.label").click()
    assert tab.inner_text("#shown") == visible_labels(tab)[2]
    assert tab.locator("#sliders output").inner_text() == "3"
    tab.locator("#frame").fill("8")
    assert tab.inner_text("#time") == "phase = 0.25 periods"
