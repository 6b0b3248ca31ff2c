"""Printed pages: no number is cut."""

import numpy as np
from pages import bar_frames, sweep_page

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
