"""The page on a touch screen, on a dark screen and in print."""

import pytest
from numpy.testing import assert_allclose
from pages import (
    find_point,
    find_violations,
    list_lines,
    odd_page,
    read_tooltip,
    screen_position,
    study_page,
    visible_ranges,
    wait_until,
)

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
