"""Zooming and panning of charts in a browser: wheel, drag, keys and buttons."""

import numpy as np
from numpy.testing import assert_allclose
from pages import (
    find_point,
    find_row,
    screen_position,
    study_page,
    tool_buttons,
    visible_ranges,
    wait_until,
)

PLOT = "[data-chart={}] .plot"
PIXEL = 0.01  # tolerance of values read from positions rounded to pixels


def test_buttons_zoom_and_reset_the_view(show):
    tab = show(study_page())
    for key in ("scatter", "observed", "error"):
        full = visible_ranges(tab, key)
        zoom_in, zoom_out, reset = (tool_buttons(tab, key).nth(k) for k in range(3))
        assert reset.is_disabled()
        zoom_in.click()
        zoomed = visible_ranges(tab, key)
        for view, everything, log in zip(zoomed, full, log_axes(key), strict=True):
            low, high, first, last = (np.log10 if log else np.asarray)([*view, *everything])
            assert_allclose([high - low, high + low], [(last - first) / 1.5, last + first])
        zoom_out.click()
        assert_allclose(visible_ranges(tab, key), full, atol=1e-12)
        zoom_out.click()
        reset.click()
        assert visible_ranges(tab, key) == full
        assert reset.is_disabled()


def log_axes(key):
    return {"scatter": (True, True), "error": (False, True)}.get(key, (False, False))


def test_zooming_is_limited(show):
    tab = show(study_page())
    for button, low_share, high_share in ((0, 1e-4, 2e-4), (1, 2.0, 4.0)):
        tab.locator(PLOT.format("observed")).press("0")
        (first, last), _ = visible_ranges(tab, "observed")
        for _ in range(40):
            tool_buttons(tab, "observed").nth(button).click()
        (low, high), _ = visible_ranges(tab, "observed")
        assert low_share <= (high - low) / (last - first) <= high_share


def test_the_wheel_scrolls_the_page_unless_a_chart_has_the_focus(show):
    tab = show(study_page())
    tab.mouse.move(*screen_position(tab, "observed", 0.5, 0.0))
    full, scroll = visible_ranges(tab, "observed"), tab.evaluate("scrollY")
    tab.mouse.wheel(0, 10)
    wait_until(tab, f"scrollY > {scroll}")
    assert visible_ranges(tab, "observed") == full
    tab.mouse.move(*screen_position(tab, "observed", 0.5, 0.0))
    scroll = tab.evaluate("scrollY")
    tab.locator(PLOT.format("observed")).focus()
    tab.mouse.wheel(0, -100)
    wait_until(tab, "state.views.observed.x !== null")
    (begin, end), (low, high) = visible_ranges(tab, "observed")
    # The pointer is the center.
    factor = np.exp(-0.25)
    assert_allclose([begin, end], [0.5 - 0.5 * factor, 0.5 + 1.5 * factor], atol=PIXEL)
    assert_allclose([low, high], np.array([-1.1, 1.1]) * factor, atol=PIXEL)
    assert tab.evaluate("scrollY") == scroll


def test_the_wheel_beside_an_axis_zooms_that_axis_only(show):
    tab = show(study_page())
    below = screen_position(tab, "observed", 1.0, -1.25)
    tab.mouse.move(*below)
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -100)
    tab.keyboard.up("Control")
    wait_until(tab, "state.views.observed.x !== null")
    assert tab.evaluate("state.views.observed.y") is None
    assert_allclose(
        visible_ranges(tab, "observed")[0], 1.0 + np.array([-1, 1]) * np.exp(-0.25), atol=PIXEL
    )


def drag(tab, start, end):
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*np.mean([start, end], axis=0))
    tab.mouse.move(*end)
    tab.mouse.up()


def test_dragging_pans_and_a_double_click_resets(show):
    tab = show(study_page())
    full = visible_ranges(tab, "observed")
    start = screen_position(tab, "observed", 1.0, 0.0)
    drag(tab, start, screen_position(tab, "observed", 0.5, 0.5))
    (begin, end), (low, high) = visible_ranges(tab, "observed")
    assert_allclose([begin, end, low, high], [0.5, 2.5, -1.6, 0.6], atol=PIXEL)
    tab.mouse.dblclick(*screen_position(tab, "observed", 1.0, 0.0))
    assert visible_ranges(tab, "observed") == full


def test_dragging_with_shift_zooms_into_a_box(show):
    tab = show(study_page())
    start, end = (
        screen_position(tab, "observed", 0.5, 0.5),
        screen_position(tab, "observed", 1.0, -0.5),
    )
    tab.keyboard.down("Shift")
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*end)
    assert tab.locator(".zoom-box").count() == 1
    tab.mouse.up()
    tab.keyboard.up("Shift")
    assert_allclose(visible_ranges(tab, "observed"), [(0.5, 1.0), (-0.5, 0.5)], atol=PIXEL)
    assert tab.locator(".zoom-box").count() == 0


def test_a_drag_that_ends_on_a_point_selects_nothing(show):
    tab = show(study_page())
    before = tab.locator("tr.selected").count()
    find_point(tab, 2).scroll_into_view_if_needed()
    box = find_point(tab, 2).bounding_box()
    start = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    drag(tab, start, [start[0] + 60.0, start[1] + 20.0])
    assert tab.locator("tr.selected").count() == before
    assert_allclose(find_point(tab, 2).bounding_box()["x"], box["x"] + 60.0, atol=1.0)
    find_point(tab, 2).click()
    assert tab.locator("tr.selected").count() == before + 1


def test_keys_zoom_pan_and_reset(show):
    tab = show(study_page())
    full = visible_ranges(tab, "observed")
    tab.locator(PLOT.format("observed")).focus()
    tab.keyboard.press("+")
    assert_allclose(visible_ranges(tab, "observed")[0], [1 / 3, 5 / 3])
    tab.keyboard.press("Shift+ArrowRight")
    assert_allclose(visible_ranges(tab, "observed")[0], np.array([1 / 3, 5 / 3]) + 2 / 15)
    tab.keyboard.press("-")
    tab.keyboard.press("0")
    assert visible_ranges(tab, "observed") == full


def test_a_point_keeps_the_focus_during_zooming(show):
    tab = show(study_page())
    find_point(tab, 2).focus()
    tab.keyboard.press("+")
    assert tab.evaluate("document.activeElement.dataset.case") == "case 2"


def test_all_panels_share_the_range_of_time(show):
    tab = show(study_page())
    tool_buttons(tab, "observed").first.click()
    times = [visible_ranges(tab, key)[0] for key in ("observed", "error", "energy", "drift")]
    assert_allclose(times, [[1 / 3, 5 / 3]] * 4)
    tool_buttons(tab, "drift").nth(2).click()
    assert visible_ranges(tab, "observed")[0] == (0.0, 2.0)
    # The vertical range of each panel is independent.
    assert tab.evaluate("state.views.observed.y") is not None


def test_the_view_persists_when_cases_are_added_but_not_for_another_quantity(show):
    tab = show(study_page())
    tool_buttons(tab, "observed").first.click()
    zoomed = visible_ranges(tab, "observed")
    find_row(tab, 5).locator("td.label").click()
    assert visible_ranges(tab, "observed") == zoomed
    tab.get_by_label("Observed: quantity").select_option("hinge.F [N]")
    times, values = visible_ranges(tab, "observed")
    assert times == zoomed[0]
    assert values[0] > 4.0
