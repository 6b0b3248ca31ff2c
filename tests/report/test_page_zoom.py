"""Zooming and panning of charts in a browser: wheel, drag, keys and buttons."""

import numpy as np
import pytest
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
PIXEL = 0.02  # tolerance of values read from positions rounded to pixels


@pytest.mark.parametrize("key", ["scatter", "observed", "error"])
def test_buttons_zoom_and_reset_the_view(show, key):
    tab = show(study_page())
    full = visible_ranges(tab, key)
    zoom_in, zoom_out, reset = (tool_buttons(tab, key).nth(k) for k in range(3))
    zoom_in.click()
    for (low, high), (first, last) in zip(visible_ranges(tab, key), full, strict=True):
        # Zooming is about the middle of the data; axes may be longer.
        assert 0.4 * (last - first) < high - low < 0.7 * (last - first)
        assert first < low < high < last
    zoom_out.click()
    assert_allclose(visible_ranges(tab, key), full, atol=1e-9)
    zoom_in.click()
    reset.click()
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
    wait_until(tab, "state.views.observed?.x")
    (begin, end), _ = visible_ranges(tab, "observed")
    assert end - begin < 2.0
    # The pointer is the center.
    assert (0.5 - begin) / (end - begin) == pytest.approx(0.25, abs=0.01)
    assert tab.evaluate("scrollY") == scroll


def test_dragging_pans(show):
    tab = show(study_page())
    tool_buttons(tab, "observed").first.click()
    (begin, end), (low, high) = visible_ranges(tab, "observed")
    start, finish = (screen_position(tab, "observed", x, x - 1.0) for x in (1.0, 0.8))
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*np.mean([start, finish], axis=0))
    tab.mouse.move(*finish)
    tab.mouse.up()
    ranges = visible_ranges(tab, "observed")
    assert_allclose(ranges, [(begin + 0.2, end + 0.2), (low + 0.2, high + 0.2)], atol=PIXEL)


def test_keys_zoom_pan_and_reset(show):
    tab = show(study_page())
    full = visible_ranges(tab, "observed")
    tab.locator(PLOT.format("observed")).focus()
    tab.keyboard.press("+")
    assert_allclose(visible_ranges(tab, "observed")[0], [1 / 3, 5 / 3], atol=1e-3)
    tab.keyboard.press("Shift+ArrowRight")
    assert_allclose(visible_ranges(tab, "observed")[0], [1 / 3 + 0.2, 5 / 3 + 0.2], atol=1e-3)
    tab.keyboard.press("-")
    tab.keyboard.press("0")
    assert visible_ranges(tab, "observed") == full


def test_a_click_on_a_point_of_a_zoomed_chart_selects_it(show):
    tab = show(study_page())
    tool_buttons(tab, "scatter").first.click()
    before = tab.locator("tr.selected").count()
    tab.mouse.click(*find_point(tab, 4))
    assert tab.locator("tr.selected").count() == before - 1


def test_all_panels_share_the_range_of_time(show):
    tab = show(study_page())
    tool_buttons(tab, "observed").first.click()
    times = [visible_ranges(tab, key)[0] for key in ("observed", "error", "energy", "drift")]
    assert_allclose(times, [[1 / 3, 5 / 3]] * 4, atol=1e-3)
    tool_buttons(tab, "drift").nth(2).click()
    # The vertical range of each panel is independent.
    times, values = visible_ranges(tab, "observed")
    assert times == (0.0, 2.0)
    assert_allclose(values, [-2 / 3, 2 / 3], atol=1e-3)


def test_the_view_persists_when_cases_are_added_but_not_for_another_quantity(show):
    tab = show(study_page())
    tab.click("#clear")
    find_row(tab, 1).locator("td.label").click()
    tool_buttons(tab, "observed").first.click()
    zoomed = visible_ranges(tab, "observed")
    find_row(tab, 5).locator("td.label").click()
    assert_allclose(visible_ranges(tab, "observed"), zoomed)
    tab.get_by_label("Observed: quantity").select_option("hinge.F [N]")
    times, values = visible_ranges(tab, "observed")
    assert_allclose(times, zoomed[0])
    assert values[0] > 4.0
