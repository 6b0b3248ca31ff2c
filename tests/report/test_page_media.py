"""Pages on screens of all sizes, on paper and for assistive technology."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import (
    bar_frames,
    find_point,
    find_row,
    find_violations,
    list_lines,
    odd_page,
    read_tooltip,
    reset_button,
    screen_position,
    study_page,
    sweep_page,
    visible_ranges,
    wait_until,
)


def selected_page():
    """Return a sweep with ten selected cases, some of them failed or without curves."""
    page = sweep_page(without={4})
    page["cases"][5] |= {"status": "Newton did not converge", "limited": True}
    return page


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("page", [study_page, sweep_page], ids=["study", "sweep"])
def test_pages_have_no_violations(open_page, page, scheme):
    tab = open_page(page(), color_scheme=scheme, viewport={"width": 1366, "height": 768})
    assert find_violations(tab) == []


def test_selections_and_failures_have_no_violations(show):
    tab = show(selected_page())
    tab.click("#clear")
    for row in tab.locator("#table tbody tr").all():
        row.locator("td.label").click()
    tab.locator("[data-chart=scatter] .plot").focus()
    tab.keyboard.press("ArrowRight")
    assert find_violations(tab) == []


def test_pages_on_a_phone_have_no_violations(phone):
    assert find_violations(phone(sweep_page())) == []


FINGER = 40  # smallest height of a touch target [px]


@pytest.mark.parametrize("page", [study_page, odd_page], ids=["study", "odd names"])
def test_nothing_overflows_sideways(phone, page):
    tab = phone(page())
    for number in (2, 5):
        tab.locator(f"#table tr[data-case='case {number}'] input").tap()
    assert tab.evaluate("document.documentElement.scrollWidth") == 390
    # The table scrolls inside its container.
    widths = "({scrollWidth, clientWidth}) => [scrollWidth, clientWidth]"
    content, visible = tab.locator("#cases .scroll").evaluate(widths)
    assert visible < 390 < content


def test_touch_targets_are_as_large_as_a_finger(phone):
    tab = phone(study_page())
    size = "element => [element.textContent, element.getBoundingClientRect().height]"
    for control in tab.locator("button:visible, select:visible, input[type=search]:visible").all():
        text, height = control.evaluate(size)
        assert height >= FINGER, text


def test_text_in_charts_is_not_scaled(phone):
    tab = phone(study_page())
    tab.set_viewport_size({"width": 844, "height": 390})
    wait_until(tab, "Math.abs(state.charts.get('scatter').width - 390) > 100")
    sizes = """[...document.querySelectorAll('.plot svg')].map((svg) => {
        const { width } = svg.getBoundingClientRect();
        return [width / svg.getAttribute('width'), width / svg.closest('.plot').clientWidth];
    })"""
    assert_allclose(tab.evaluate(sizes), 1.0, atol=0.01)


def test_a_tap_reads_values_and_selects_cases(phone):
    tab = phone(study_page())
    tab.touchscreen.tap(*screen_position(tab, "observed", 1.0, 0.0))
    words = read_tooltip(tab).split()
    assert float(words[2]) == pytest.approx(1.0, abs=0.02)
    before = tab.locator("tr.selected").count()
    tab.touchscreen.tap(*find_point(tab, 2))
    wait_until(tab, f"document.querySelectorAll('tr.selected').length === {before - 1}")


def create_touch(tab):
    """Return a function that places, moves or lifts fingers."""
    session = tab.context.new_cdp_session(tab)

    def touch(kind, *positions):
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(positions)]
        session.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})

    return touch


def test_two_fingers_zoom_and_one_pans(phone):
    tab = phone(study_page())
    touch = create_touch(tab)
    left, right = (
        screen_position(tab, "observed", 0.5, 0.0),
        screen_position(tab, "observed", 1.5, 0.0),
    )
    middle = [(a + b) / 2 for a, b in zip(left, right, strict=True)]
    quarter = (right[0] - left[0]) / 4
    touch("Start", [middle[0] - quarter, left[1]], [middle[0] + quarter, left[1]])
    for k in range(1, 7):
        reach = (1.0 + 0.5 * k) * quarter
        touch("Move", [middle[0] - reach, left[1]], [middle[0] + reach, left[1]])
    touch("End")
    tab.wait_for_timeout(200)
    begin, end = visible_ranges(tab, "observed")[0]
    assert 0.2 < end - begin < 1.9
    finger = screen_position(tab, "observed", 1.0, 0.0)
    touch("Start", finger)
    for k in (1, 2, 3, 4):
        touch("Move", [finger[0] + 15 * k, finger[1]])
    touch("End")
    new_begin, new_end = visible_ranges(tab, "observed")[0]
    assert new_begin < begin - 0.05
    assert_allclose(new_end - new_begin, end - begin)


def test_colors_of_dark_screens_and_print(open_page):
    tab = open_page(study_page(), color_scheme="dark")
    color = "getComputedStyle(document.body).backgroundColor"
    assert tab.evaluate(color) == "rgb(21, 24, 28)"
    assert list_lines(tab)[0][1] == "#3d9fdb"
    tab.emulate_media(media="print")
    assert tab.evaluate(color) == "rgb(255, 255, 255)"
    assert not tab.locator(".tools").first.is_visible()
    assert tab.locator(".plot").first.is_visible()


def facts_page():
    """Return a page with tables of facts of the widths that runs and fits have."""
    number = "-0.00066501"
    heads = {
        "Observed": ["observed", "min", "max", "end"],
        "Validity": ["beam", "deflection of length", "rotation [rad]", "strain [-]", "error [-]"],
        "Estimates": ["parameter", "value", "standard deviation", "lower 95 %", "upper 95 %"],
        "Budget": [
            "observed",
            *("total", "time", "mesh", "theory", "companion", "status"),
        ],
    }
    texts = {
        "Observed": number,
        "Validity": "0.00037",
        "Estimates": "2.36842e+09",
        "Budget": "1.9e-06",
    }
    tables = [
        {
            "title": x,
            "head": head,
            "rows": [["rocker.angle_dot [rad/s]", *[texts[x]] * (len(head) - 1)]],
        }
        for x, head in heads.items()
    ]
    tables.append(
        {"title": "Run", "rows": [["integrator", "Auto rtol=1e-05 " * 9], ["steps", "1"]]}
    )
    return {"title": "facts", "tables": tables}


@pytest.mark.parametrize("width", [390, 360])
def test_regression_tables_of_facts_fit_the_screen_of_a_phone(phone, width):
    """The last columns of the error table were beyond the edge of the screen."""
    tab = phone(facts_page())
    tab.set_viewport_size({"width": width, "height": 800})
    overflow = """[...document.querySelectorAll(".facts .scroll")].map(
        (box) => [box.getAttribute("aria-label"), box.scrollWidth - box.clientWidth])"""
    assert [x for x in tab.evaluate(overflow) if x[1] > 0] == []
    # Rows of wide tables are blocks with the names of the columns.
    named = tab.locator(".cards").last.locator("td").last
    assert named.evaluate("(cell) => getComputedStyle(cell, '::before').content") == '"status"'
    # Names are wrapped between words only.
    count = """(cell) => {
        const range = document.createRange();
        range.selectNodeContents(cell);
        return range.getClientRects().length;
    }"""
    assert tab.get_by_text("integrator", exact=True).evaluate(count) == 1
    assert find_violations(tab) == []


# Size of the printed area at margins of 12 mm [px].
A4_LANDSCAPE, A4_PORTRAIT = 1032, 703

SHEET_HEIGHT = A4_PORTRAIT  # of a sheet in landscape
CUT_CELLS = """() => {
    const cut = [];
    for (const table of document.querySelectorAll("table")) {
        for (const cell of table.querySelectorAll("th, td")) {
            const style = getComputedStyle(cell);
            if (style.display === "none" || !cell.getBoundingClientRect().width) continue;
            const range = document.createRange();
            range.selectNodeContents(cell);
            const right = range.getBoundingClientRect().right;
            if (right > document.documentElement.clientWidth + 0.5) cut.push(cell.textContent);
        }
    }
    return cut;
}"""


def wide_page(columns=14):
    page = sweep_page()
    names = [f"response {k} [m]" for k in range(columns)]
    page["columns"] += [
        {"key": x, "label": x.partition(" [")[0], "unit": "m", "kind": "number"} for x in names
    ]
    for k, case in enumerate(page["cases"]):
        case["values"] |= dict.fromkeys(names, -1.92345e-11 * (k + 1))
    page["tables"] = [
        {
            "title": "wide",
            "head": ["column", *names],
            "rows": [["tip", *(["-1.92e-11"] * columns)]],
            "section": "errors",
        }
    ]
    return page


def print_on(tab, width):
    tab.set_viewport_size({"width": width, "height": 700})
    tab.emulate_media(media="print")
    tab.evaluate("window.dispatchEvent(new Event('beforeprint'))")


def test_regression_printed_tables_are_reduced_to_the_paper(show):
    """On A4, the table was cut at the edge: 1.92e-11 was printed as 1.92e-1."""
    tab = show(wide_page())
    print_on(tab, A4_LANDSCAPE)
    assert tab.evaluate(CUT_CELLS) == []
    assert tab.locator("#table th .name:visible").count() == 18
    tab.emulate_media(media="screen")
    tab.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert tab.locator("#table").get_attribute("style") in ("", None)


def test_pages_print_to_a4_with_the_motion_on_the_first_sheet(show):
    tab = show(sweep_page())
    pdf = tab.pdf(prefer_css_page_size=True)
    assert pdf.count(b"/Type /Page\n") < 6


def run_page():
    """Return the page of a run with two columns, tables of facts and a long table."""
    page = sweep_page()
    names = [f"column {k} [m]" for k in range(14)]
    table = {"title": "Observed", "head": ["observed", "min", "max"]}
    facts = {"title": "Run", "rows": [["steps", "100"], ["status", "ok"]], "section": "solver"}
    case = page["cases"][0] | {"values": {}, "at": None}
    return page | {
        "columns": [],
        "sliders": [],
        "groups": [{"id": "bar", "frames": bar_frames()}],
        "tables": [table | {"rows": [[x, "-0.1234", "1.234"] for x in names]}, facts],
        "cases": [case],
    }


def test_regression_curves_are_printed_beside_the_motion(show):
    """The curves were on a second sheet, below half a sheet of empty space."""
    tab = show(run_page())
    print_on(tab, A4_LANDSCAPE)
    motion, first = (tab.locator(x).first.bounding_box() for x in ("#motion", ".panel"))
    assert first["x"] > motion["x"] + motion["width"]
    boxes = [panel.bounding_box() for panel in tab.locator("#panels .panel").all()]
    assert max(box["y"] + box["height"] for box in boxes) < SHEET_HEIGHT
    assert tab.pdf(prefer_css_page_size=True).count(b"/Type /Page\n") < 4


def test_regression_heads_of_tables_are_printed_on_each_sheet(show):
    """Sheets after the first one had numbers without the names of their columns."""
    tab = show(sweep_page())
    print_on(tab, A4_LANDSCAPE)
    # Chromium leaves out buttons when it repeats a head.
    display = [
        tab.locator(x).first.evaluate("(element) => getComputedStyle(element).display")
        for x in ("#table thead", "#table th button")
    ]
    assert display == ["table-header-group", "contents"]


def test_regression_printed_charts_without_a_motion_cover_no_table(show):
    """The tables of a linear model were printed over the chart of the phase."""
    frequencies = np.logspace(0.0, 2.0, 50)
    response = {"tip.y [m]": 1.0 / frequencies}
    curves = {"t": frequencies, "magnitude": response, "phase": response}
    table = {"title": "Poles", "head": ["pole", "frequency"], "rows": [["1", "2.0"]] * 20}
    page = {
        "title": "linear",
        "groups": [{"id": "g"}],
        "axes": None,
        "columns": [{"key": "at", "label": "at", "unit": "Hz", "kind": "number"}],
        "tables": [table],
        "cases": [{"id": "c", "group": "g", "label": "tip.y", "curves": curves}],
    }
    tab = show(page)
    print_on(tab, A4_LANDSCAPE)
    boxes = [tab.locator(x).bounding_box() for x in ("#curves .plot >> nth=1", "#result-facts")]
    assert boxes[0]["y"] + boxes[0]["height"] <= boxes[1]["y"]
    first, second = (tab.locator("#curves .plot").nth(k).bounding_box() for k in (0, 1))
    assert first["y"] == second["y"]  # side by side
    assert first["x"] + first["width"] <= second["x"]


def test_regression_tables_without_curves_use_the_whole_width(show):
    """At 1366 px, the table of modes was beside the motion and its last columns were cut."""
    page = wide_page(columns=7)
    for case in page["cases"]:
        case["curves"] = None
    tab = show(page)
    assert tab.locator("main.without-curves").count() == 1
    table, motion = (tab.locator(x).bounding_box() for x in ("#cases", "#motion"))
    assert table["x"] == motion["x"]
    assert table["width"] > 1300.0
    chart = tab.locator("#precision").bounding_box()
    assert chart["x"] > motion["x"] + motion["width"]


PLOT = "[data-chart={}] .plot"
PIXEL = 0.02  # tolerance of values read from positions rounded to pixels


def zoom_in(tab, key):
    """Zoom in about the middle of a chart."""
    before = visible_ranges(tab, key)
    box = tab.locator(PLOT.format(key)).bounding_box()
    tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -100)
    tab.keyboard.up("Control")
    for _ in range(50):
        tab.wait_for_timeout(100)
        if visible_ranges(tab, key) != before:
            break


@pytest.mark.parametrize("key", ["scatter", "observed", "error"])
def test_a_button_resets_the_view(show, key):
    tab = show(study_page())
    full = visible_ranges(tab, key)
    tab.locator(PLOT.format(key)).scroll_into_view_if_needed()
    zoom_in(tab, key)
    for (low, high), (first, last) in zip(visible_ranges(tab, key), full, strict=True):
        assert first < low < high < last
    reset_button(tab, key).click()
    assert visible_ranges(tab, key) == full


def test_the_wheel_scrolls_the_page_unless_ctrl_is_pressed(show):
    tab = show(study_page())
    tab.mouse.move(*screen_position(tab, "observed", 0.5, 0.0))
    full, scroll = visible_ranges(tab, "observed"), tab.evaluate("scrollY")
    tab.mouse.wheel(0, 10)
    wait_until(tab, f"scrollY > {scroll}")
    assert visible_ranges(tab, "observed") == full
    tab.mouse.move(*screen_position(tab, "observed", 0.5, 0.0))
    scroll = tab.evaluate("scrollY")
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -100)
    tab.keyboard.up("Control")
    tab.wait_for_timeout(100)
    (begin, end), _ = visible_ranges(tab, "observed")
    assert end - begin < 2.0
    # The pointer is the center.
    assert (0.5 - begin) / (end - begin) == pytest.approx(0.25, abs=0.01)
    assert tab.evaluate("scrollY") == scroll


def test_dragging_pans(show):
    tab = show(study_page())
    for _ in range(4):
        zoom_in(tab, "observed")
    (begin, end), (low, high) = visible_ranges(tab, "observed")
    start, finish = (screen_position(tab, "observed", x, x - 1.0) for x in (1.0, 0.8))
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*np.mean([start, finish], axis=0))
    tab.mouse.move(*finish)
    tab.mouse.up()
    ranges = visible_ranges(tab, "observed")
    assert_allclose(ranges, [(begin + 0.2, end + 0.2), (low + 0.2, high + 0.2)], atol=PIXEL)


def test_a_click_on_a_point_of_a_zoomed_chart_selects_it(show):
    tab = show(study_page())
    tab.locator(PLOT.format("scatter")).scroll_into_view_if_needed()
    zoom_in(tab, "scatter")
    before = tab.locator("tr.selected").count()
    tab.mouse.click(*find_point(tab, 4))
    assert tab.locator("tr.selected").count() == before - 1


def test_all_panels_share_the_range_of_time(show):
    tab = show(study_page())
    zoom_in(tab, "observed")
    times = [visible_ranges(tab, key)[0] for key in ("observed", "error", "energy", "drift")]
    assert times[0] != (0.0, 2.0)
    assert_allclose(times, [times[0]] * 4, atol=1e-3)
    _, zoomed = visible_ranges(tab, "observed")
    reset_button(tab, "drift").click()
    # The vertical range of each panel is independent.
    assert visible_ranges(tab, "observed") == ((0.0, 2.0), zoomed)


def test_the_view_persists_when_cases_are_added_but_not_for_another_quantity(show):
    tab = show(study_page())
    tab.click("#clear")
    find_row(tab, 1).locator("td.label").click()
    zoom_in(tab, "observed")
    zoomed = visible_ranges(tab, "observed")
    find_row(tab, 5).locator("td.label").click()
    assert_allclose(visible_ranges(tab, "observed"), zoomed)
    tab.get_by_label("Observed: quantity").select_option("hinge.F [N]")
    times, values = visible_ranges(tab, "observed")
    assert_allclose(times, zoomed[0])
    assert values[0] > 4.0
