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
    count_curves,
    find_point,
    find_row,
    find_violations,
    list_lines,
    odd_page,
    read_page,
    read_tooltip,
    screen_position,
    selected_options,
    study_page,
    sweep_page,
    visible_ranges,
    wait_until,
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


# Charts of pages: curves, scatter plots and sliders of sweeps.

PLOT = "[data-chart={}] .plot"


def select_only(tab, *numbers):
    """Select these cases and no others."""
    tab.click("#clear")
    for number in numbers:
        find_row(tab, number).locator("td.label").click()


def test_axes_show_the_multiples_of_units_of_pictures(show):
    tab = show(study_page())
    expected = {
        ("Pa", 6): "MPa",
        ("Pa", -3): "mPa",
        ("m", -6): "µm",
        ("m", 3): "10³ m",
        ("m/s^2", -3): "mm/s^2",
        ("N m", 3): "kN m",
        ("-", -6): "10⁻⁶",
        ("", 3): "10³",
        ("Hz", 0): "Hz",
        ("Hz", 9): "GHz",
    }
    assert tab.evaluate("pairs => pairs.map(([u, o]) => scaleUnit(u, o))", [*expected]) == [
        *expected.values()
    ]
    sizes = [0.0, 3e-7, 9.9e-3, 1e-2, 1.0, 9999.0, 1e4, 2e8]
    orders = tab.evaluate("sizes => sizes.map((x) => engineeringOrder([-x, x / 2]))", sizes)
    assert orders == [0, -9, -3, 0, 0, 0, 3, 6]


def test_values_are_read_in_the_unit_of_the_axis(show):
    page = study_page()
    t = np.linspace(0.0, 2.0, 101)
    for case in page["cases"]:
        case["curves"] = {"t": t, "observed": {"stress [Pa]": 1e8 * t}}
    tab = show(page)
    select_only(tab, 2)
    assert "stress [MPa]" in tab.locator("[data-chart=observed] text").all_text_contents()
    tab.mouse.move(*screen_position(tab, "observed", 1.0, 1e8))
    number, unit = read_tooltip(tab).split()[-2:]
    assert float(number) == pytest.approx(100.0, abs=2.0)
    assert unit == "MPa"


def test_regression_constants_but_for_rounding_errors_are_drawn_as_constants(show):
    """661.753049 to 661.753051 MPa looked like a violent vibration."""
    page = study_page()
    for case in page["cases"]:
        rounding = 661.75305 + 1e-6 * np.cos(9.0 * T)
        case["curves"] = {"t": T, "observed": {"stress [MPa]": rounding}}
    low, high = visible_ranges(show(page), "observed")[1]
    assert high - low > 100.0


def test_regression_rounding_noise_does_not_choose_a_logarithmic_axis(show):
    """One case of 2e-12 N m beside 1172 and 1250 N m made the axis logarithmic from 1e-12."""
    tab = show(study_page())
    values = {
        (2e-12, 1172.0, 1250.0): False,
        (1e-12, 3e-12, 1250.0): False,
        (0.0, 1.0, 1000.0): False,
        (-1.0, 1000.0): False,
        (100.0, 1172.0, 1250.0): False,
        (): False,
        (1.0, 1172.0, 1250.0): True,
        (1e-4, 1.0, 1e4, 1e8): True,  # a parameter over twelve decades
    }
    needs = "needsLogAxis({ kind: 'number', value: (x) => x }, values)"
    assert [tab.evaluate(f"values => {needs}", list(x)) for x in values] == [*values.values()]


def test_values_are_read_at_the_pointer_and_by_keys(show):
    tab = show(study_page())
    select_only(tab, 2)
    tab.mouse.move(*screen_position(tab, "observed", 1.0, 0.5))
    words = read_tooltip(tab).split()
    assert float(words[2]) == pytest.approx(1.0, abs=0.02)
    assert float(words[-2]) == pytest.approx(-1.0, abs=1e-3)
    # The motion, which is shorter, follows.
    assert tab.inner_text("#time") == "t = 0.5 s"
    tab.mouse.move(1, 1)
    tab.locator(PLOT.format("observed")).focus()
    for _ in range(len(T)):
        tab.keyboard.press("ArrowRight")
    words = tab.inner_text("#reading").split()
    assert float(words[2]) == pytest.approx(2.0, abs=0.03)
    assert tab.locator("[data-chart=observed] .time-line").count() == 1


def test_the_choice_of_the_observed_column_persists(show):
    tab = show(study_page())
    choice = tab.get_by_label("Observed: quantity")
    assert choice.input_value() == "tip.x [m]"
    choice.select_option("hinge.F [N]")
    assert choice.evaluate("select => select === document.activeElement")
    for _ in range(2):
        assert "hinge.F [N]" in tab.locator("[data-panel=observed] text").all_text_contents()
        find_row(tab, 5).locator("td.label").click()


@pytest.mark.parametrize("shortening", [1e-7, 2e-5])
def test_regression_the_page_opens_on_a_column_that_moves_as_much_as_others(show, shortening):
    """It opened on the shortening of a bent beam, 5e-8 m beside 5e-4 m across the beam."""
    page = study_page()
    for case in page["cases"]:
        if case["curves"]:
            columns = {"tip.x [m]": 1.0 - shortening * T, "tip.y [m]": 1e-3 * T}
            columns["tip.F [N]"] = 1e-6 * T
            case["curves"]["observed"] = columns
    choice = show(page).get_by_label("Observed: quantity")
    assert choice.input_value() == "tip.y [m]"
    assert choice.locator("option").first.inner_text() == "tip.y [m]"


def test_lines_differ_by_color_and_dashes(show):
    tab = show(study_page())
    select_only(tab, 2, 1, 5, 4)
    lines = list_lines(tab)
    assert len(lines) == 4
    assert len({color for _, color, _ in lines}) == 4
    assert len({dashes for *_, dashes in lines}) == 4
    icons = tab.locator("#selection svg path").all()
    assert len({icon.get_attribute("stroke-dasharray") for icon in icons}) == 4


def test_entries_of_the_selection_remove_cases(show):
    tab = show(study_page())
    select_only(tab, 2, 5)
    tab.locator(".selection-entry", has_text="Ida(rtol=0.001)").click()
    assert count_curves(tab) == [1, 1, 1, 1]
    assert not find_row(tab, 2).locator("input").is_checked()


def test_entries_of_the_legend_hide_families(show):
    tab = show(study_page())
    drawn = "[data-chart=scatter] svg path[fill='#0072b2']"
    entry = tab.locator("[data-chart=scatter] text", has_text=re.compile("^Ida$"))
    entry.scroll_into_view_if_needed()
    box = entry.bounding_box()
    for shown in ("=== 0", "> 0"):
        tab.mouse.click(box["x"] + 5.0, box["y"] + 5.0)
        wait_until(tab, f'document.querySelectorAll("{drawn}").length {shown}')
    assert tab.locator("#table tbody tr:visible").count() == 7


def test_curves_of_the_same_unit_share_a_chart(show):
    page = study_page()
    page["cases"] = page["cases"][:2]
    for case in page["cases"]:
        case["curves"]["observed"] = {
            "a [m]": T,
            "b [m]": 2 * T,
            "c [N]": T,
        }
    tab = show(page)
    choice = tab.get_by_label("Observed: quantity")
    assert choice.locator("option").all_inner_texts() == ["a [m]", "b [m]", "c [N]", "all in m"]
    choice.select_option("all in m")
    assert [name for name, *_ in list_lines(tab)] == [
        "a [m], Ida(rtol=0.001)",
        "b [m], Ida(rtol=0.001)",
        "a [m], Ida(rtol=1e-05)",
        "b [m], Ida(rtol=1e-05)",
    ]
    # Colors distinguish the two cases, dashes the names.
    looks = [look for _, *look in list_lines(tab)]
    assert looks[0][0] == looks[1][0] != looks[2][0] == looks[3][0]
    assert looks[0][1] == looks[2][1] != looks[1][1] == looks[3][1]
    select_only(tab, 2)
    assert [name for name, *_ in list_lines(tab)] == ["a [m]", "b [m]"]
    assert len({color for _, color, _ in list_lines(tab)}) == 2


def test_axes_of_the_scatter_plot_show_any_two_quantities(show):
    page = study_page()
    page["columns"] += [{"key": "speed", "label": "speed", "unit": "m/s", "kind": "number"}]
    for k, case in enumerate(page["cases"]):
        case["values"]["speed"] = 2.0 + k
    tab = show(page)
    tab.get_by_label("x axis").select_option("speed [m/s]")
    assert tab.inner_text("#precision h2") == "Error over speed"
    assert_allclose(visible_ranges(tab, "scatter")[0], [2.0, 7.0])
    tab.get_by_label("y axis").select_option("steps")
    # The resolution of the reference belongs to errors only.
    assert "resolution" not in tab.inner_text("#precision")
    tab.mouse.move(*find_point(tab, 1))
    assert "speed [m/s]\t3" in read_tooltip(tab)


def test_the_page_defines_the_initial_axes(show):
    page = study_page() | {"axes": {"x": "error", "y": "steps"}}
    tab = show(page)
    assert tab.inner_text("#precision h2") == "steps over error"


def test_regression_legends_of_several_lines_do_not_cover_the_axis(phone):
    """The second line of a legend lay on the title of the axis."""
    page = study_page()
    page["families"] = [f"family number {k}" for k in range(len(page["cases"]))]
    for case, family in zip(page["cases"], page["families"], strict=True):
        case["family"] = family
    texts = phone(page).locator("[data-chart=scatter] svg text").all()
    bottoms = {x.text_content(): x.bounding_box() for x in texts}
    entries = [box["y"] for text, box in bottoms.items() if text in page["families"]]
    assert len(set(entries)) > 1
    title = bottoms["wall time [s]"]
    assert min(entries) > title["y"] + title["height"]


def bar_length(tab):
    """Return the drawn length of the bar, in pixels."""
    path = tab.locator("#stage .body.beam:not(.initial)").get_attribute("d")
    points = np.array(re.findall(r"-?[\d.]+", path), float).reshape(-1, 2)
    return np.hypot(*(points[-1] - points[0]))


def slide(tab, axis, position):
    tab.locator(f"#slider-{axis}").evaluate(
        """(slider, value) => {
            slider.value = value;
            slider.dispatchEvent(new Event("input"));
            slider.dispatchEvent(new Event("change"));
        }""",
        str(position),
    )


def test_sliders_show_the_nearest_stored_motion(show):
    tab = show(sweep_page())
    assert tab.inner_text("#shown") == "speed=1, height=0.1"
    short = bar_length(tab)
    tab.locator("#frame").fill("10")
    tab.click("#clear")
    slide(tab, 0, 2)
    assert tab.locator("#sliders output").all_inner_texts() == ["4", "0.1"]
    assert_allclose(bar_length(tab), 4.0 * short, rtol=0.01)
    # The time persists, and the case next to the sliders is selected in place of the one before.
    assert tab.inner_text("#time") == "t = 0.25 s"
    slide(tab, 1, 1)
    (entry,) = tab.locator(".selection-entry").all_inner_texts()
    assert "speed=4, height=0.2" in entry
    assert tab.inner_text("#shown") in ("speed=4, height=0.1", "speed=4, height=0.3")


def test_a_selected_case_moves_the_sliders(show):
    tab = show(sweep_page())
    tab.click("#clear")
    find_row(tab, 8).locator("td.label").click()
    assert tab.locator("#sliders output").all_inner_texts() == ["4", "0.3"]
    assert tab.inner_text("#shown") == "speed=4, height=0.3"


def test_a_case_without_curves_says_why(show):
    tab = show(sweep_page(without={4}))
    tab.click("#clear")
    find_row(tab, 4).locator("td.label").click()
    note = tab.inner_text("#selection-notes")
    assert "speed=2, height=0.2 has no curves on this page, which stores those of 8 of 9" in note
    assert "trajectories/4.csv" in note


def test_regression_a_measured_sweep_opens_on_its_responses(show):
    """The page opened on an empty box with the text "No case of this model has curves."."""
    page = sweep_page(without=range(9))
    for case in page["cases"]:
        case["frames"] = None
    tab = show(page)
    assert not tab.locator("#top").is_visible()
    assert "has curves" not in tab.inner_text("main")
    chart = tab.locator("[data-chart=scatter]").bounding_box()
    assert chart["y"] + chart["height"] < 768


def test_of_many_families_the_legend_names_the_first_and_the_last(show):
    page = sweep_page()
    for k, case in enumerate(page["cases"]):
        case["family"] = case["series"] = f"height={k}"
    texts = show(page).locator("[data-chart=scatter] text").all_text_contents()
    assert [x for x in texts if x.startswith("height=")] == ["height=0", "height=8"]


def test_columns_of_the_solver_are_shown_on_request(show):
    tab = show(sweep_page())
    heads = tab.locator("#table th .name")
    assert "residuals" not in heads.all_inner_texts()
    tab.get_by_label("solver columns").check()
    assert "residuals" in heads.all_inner_texts()
