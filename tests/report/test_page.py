"""Pages: their file, and the content of the page of a run."""

import json
import math
import re
from copy import deepcopy

import numpy as np
import pytest
from benchmarks.cases import PENDULUM
from mechanisms import hinged
from numpy.testing import assert_allclose
from pages import (
    ODD_NAMES,
    ROUNDING,
    T,
    build_case,
    find_violations,
    list_lines,
    odd_page,
    read_page,
    selected_options,
    study_page,
)

import beamdae as bd
from beamdae.report.page.page_file import write_page
from beamdae.report.pictures.time_plots import PlotSelection
from beamdae.report.run_pages import build_run_page


def test_pages_store_all_entries(tmp_path):
    page = study_page() | {"title": "{{script}} {{data}}"}
    before = deepcopy(page)
    path = write_page(tmp_path / "new" / "page.html", page)
    assert page["notes"] == before["notes"]
    data = read_page(path)
    for name in ("title", "subtitle", "made", "notes", "columns"):
        assert data[name] == page[name]
    ignored = dict.fromkeys(("curves", "series", "rank", "frames", "at", "file"))
    for actual, expected in zip(data["cases"], page["cases"], strict=True):
        assert actual | ignored == expected | ignored
    actual, expected = data["cases"][0]["curves"], page["cases"][0]["curves"]
    assert_allclose(actual["t"], T, rtol=ROUNDING)
    for name, values in expected["observed"].items():
        assert_allclose(actual["observed"][name], values, rtol=ROUNDING)
    frames = data["groups"][0]["frames"]
    assert [(b["name"], b["kind"], b["points"]) for b in frames["glyphs"]] == [
        ("ground", "ground", 1),
        ("bar", "beam", 3),
        ("bob", "point", 1),
    ]
    x = page["groups"][0]["frames"]["glyphs"][1]["x"]
    assert_allclose(frames["glyphs"][1]["x"], x, atol=2.0 * ROUNDING)


def test_missing_and_infinite_numbers_are_stored_as_missing(tmp_path):
    odd = np.array([1.0, math.nan, 1e300, math.inf, -math.inf, 3.0])
    page = study_page()
    page["cases"] = [
        build_case(
            0,
            "Ida",
            math.nan,
            math.inf,
            curves={"t": np.arange(6.0), "observed": {"x": odd}},
        )
        | {"values": {"steps": -math.inf}},
    ]
    (first,) = read_page(write_page(tmp_path / "page.html", page))["cases"]
    assert (first["error"], first["cost"], first["values"]["steps"]) == (None, None, None)
    stored = first["curves"]["observed"]["x"]
    assert_allclose(stored[np.isfinite(stored)], [1.0, 3.0])


def test_names_cannot_end_the_data_and_nothing_is_loaded(tmp_path):
    text = write_page(tmp_path / "page.html", study_page()).read_text()
    assert text.count("</script>") == 3
    assert "<b>" not in text
    assert f"<title>{study_page()['title']}</title>" not in text
    # The namespace of SVG is an identifier, not an address.
    addresses = set(re.findall(r"https?://[^\s\"'`]*", text))
    assert all(address.startswith("http://www.w3.org/") for address in addresses)
    own = text.replace(re.findall(r"<script>\s*(var echarts=.*?)</script>", text, re.DOTALL)[0], "")
    assert not re.search(r"\b(src|href)\s*=|@import|url\((?!#)", own)


def test_odd_names_are_stored_unchanged(tmp_path):
    text = write_page(tmp_path / "page.html", odd_page()).read_text(encoding="utf-8")
    assert text.count("</script>") == 3
    own = re.sub(r"<script>\s*var echarts=.*?</script>", "", text, flags=re.DOTALL)
    assert not set(map(chr, [*range(9), *range(14, 32), 0x2028])) & set(own)
    (json_text,) = re.findall(r'id="data">(.*?)</script>', text, re.DOTALL)
    data = json.loads(json_text)
    assert data["title"] == "".join(ODD_NAMES)
    assert data["cases"][4]["values"]["u16"] == "u16"


@pytest.fixture(scope="module")
def run():
    mech, arm = hinged(bd.RigidBody.rod("arm", (0.0, 0.0), (1.0, 0.0), mass=1.0), gravity=9.81)
    mech.observe("tip", arm.at(1.0, 0.0))
    return bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=0.5)


def test_regression_lists_among_the_parameters_are_shown():
    @bd.model(t_end=0.1)
    def bodies(masses=(1.0, 2.5), gravity=9.81):
        mech = bd.Mechanism(gravity=(0.0, -gravity))
        for k, mass in enumerate(masses):
            mech.add(bd.PointMass(f"mass {k}", mass, at=(k, 0.0)))
        return mech

    page = build_run_page(bd.simulate(bodies, bd.Radau()), "bodies")
    (table,) = (table for table in page["tables"] if table["title"] == "Parameters")
    assert table["rows"] == [["masses", "(1, 2.5)"], ["gravity", "9.81"]]


def test_the_page_contains_facts_tables_and_curves(run):
    columns = run.all_columns()
    page = build_run_page(run, "arm", warnings=["Beware."])
    assert (page["title"], page["subtitle"]) == ("arm", "Radau: reached the end")
    assert page["notes"] == ["Beware."]
    tables = {table["title"]: table for table in page["tables"]}
    # Tables without rows are left out.
    assert {title: table["section"] for title, table in tables.items()} == {
        "Observed": "results",
        "Run": "solver",
        "Provenance": "solver",
    }
    assert tables["Observed"]["head"] == ["observed", "end", "min", "max"]
    first, *_, rate = tables["Observed"]["rows"]
    assert (first[0], rate[0]) == ("tip.x [m]", "tip.angle_dot [rad/s]")
    assert float(first[1]) == pytest.approx(columns["tip.x [m]"][-1], rel=1e-4)
    (case,) = page["cases"]
    curves = case["curves"]
    assert_allclose(curves["t"], run.t)
    assert_allclose(curves["observed"]["tip.y [m]"], columns["tip.y [m]"])
    assert_allclose(curves["energy"]["kinetic"], columns["energy.kinetic [J]"])
    assert_allclose(curves["energy"]["imbalance"], np.abs(columns["energy.imbalance [J]"]))
    # Energies that do not change are omitted.
    assert "work of loads" not in curves["energy"]
    assert_allclose(curves["drift"]["position drift"], run.drift["drift.position"])
    (group,) = page["groups"]
    assert "arm" in [symbol["name"] for symbol in group["frames"]["glyphs"]]


def test_regression_the_potential_of_gravity_on_pages_begins_at_zero(run):
    """A potential of -0.9 J drew energies of some mJ as one line."""
    (case,) = build_run_page(run, "arm")["cases"]
    energies, gravity = case["curves"]["energy"], run.all_columns()["energy.gravity [J]"]
    assert_allclose(energies["gravity from start"], gravity - gravity[0])
    assert "gravity" not in energies


def test_the_page_of_equations_has_no_animation(tmp_path):
    run = bd.simulate(PENDULUM.build(), bd.Radau(), t_end=0.1)
    page = build_run_page(run, "spring")
    assert page["groups"][0]["frames"] is None
    assert write_page(tmp_path / "page.html", page).is_file()


def test_curves_of_long_runs_are_thinned(run):
    long = run.at_times(np.linspace(run.t[0], run.t[-1], 5000))
    curves = build_run_page(long, "arm")["cases"][0]["curves"]
    assert len(curves["t"]) == 2000
    assert curves["t"][-1] == run.t[-1]


def test_the_page_of_a_run_in_a_browser(run, show):
    tab = show(build_run_page(run, "arm"))
    assert tab.inner_text("h1") == "arm"
    for hidden in ("#precision", "#cases", "#choice", "#selection button"):
        assert not tab.locator(hidden).first.is_visible()
    # Motion and curves come first, the solver last.
    visible = [x.inner_text() for x in tab.locator("h2").all() if x.is_visible()]
    assert visible == ["Motion", "Over time", "Solver"]
    tables = [x for x in tab.locator(".facts h3").all_inner_texts() if x != "Parameters"]
    assert tables == ["Observed", "Run", "Provenance"]
    panels = tab.locator(".panel h3").all_inner_texts()
    assert panels == ["Observed", "Energy [J]", "Drift of the joints"]
    # All energies share a panel.
    assert selected_options(tab.get_by_label("Energy [J]: quantity")) == ["all in J"]
    # The work of loads and other energies that stay zero are listed as constant.
    assert [name for name, *_ in list_lines(tab, "energy")] == ["kinetic", "gravity from start"]
    assert "arm" in tab.locator("#stage title").all_text_contents()


def test_the_page_of_a_failed_run_shows_its_status_and_last_time(run, show):
    page = build_run_page(run, "arm")
    page["cases"][0]["status"] = "Newton did not converge"
    page["subtitle"] = "Radau: Newton did not converge"
    tab = show(page)
    assert tab.inner_text("#subtitle") == "Radau: Newton did not converge"
    # A cross marks the end of the curve.
    marker = """(({symbol, data}) => symbol(null, {dataIndex: data.length - 1}))(
        state.charts.get("observed").spec.series[0])"""
    assert tab.evaluate(marker) != "none"
    assert not tab.locator("#unplotted").is_visible()


@pytest.mark.slow(reason="axe-core tests two pages")
@pytest.mark.parametrize(("scheme", "size"), [("light", (1366, 768)), ("dark", (390, 844))])
def test_the_page_has_no_violations(run, open_page, size, scheme):
    assert run.errors.headers
    page = build_run_page(run, "arm", warnings=["A warning."])
    width, height = size
    tab = open_page(page, viewport={"width": width, "height": height}, color_scheme=scheme)
    assert find_violations(tab) == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= width


def test_measured_values_are_points_and_the_page_opens_on_their_column(run):
    times, values = np.array([0.1, 0.2]), np.array([-0.05, -0.2])
    points = {"tip.y [m]": {"": (times, values), "second": (times, -values)}}
    page = build_run_page(run, "arm", charts=PlotSelection("t [s]", ["tip.y [m]"], points))
    assert page["featured"] == ["tip.y [m]"]
    _, first, second = page["cases"]
    assert (first["label"], second["label"]) == ("data of tip.y [m]", "data of tip.y [m], second")
    assert_allclose(first["curves"]["t"], times)
    assert_allclose(second["curves"]["observed"]["tip.y [m]"], -values)
    assert first["points"]


@pytest.mark.slow(reason="opens a browser")
def test_the_page_of_a_run_with_data_in_a_browser(run, show):
    points = {"tip.y [m]": {"": (np.array([0.1, 0.2]), np.array([-0.05, -0.2]))}}
    tab = show(build_run_page(run, "arm", charts=PlotSelection("t [s]", ["tip.y [m]"], points)))
    assert [name for name, *_ in list_lines(tab)] == ["arm", "data of tip.y [m]"]
    assert len(list_lines(tab, "energy")) > 1
    choices = tab.locator("#panels [data-panel] select")
    assert [selected_options(choices.nth(k)) for k in range(2)] == [["tip.y [m]"], ["all in J"]]
    assert find_violations(tab) == []
