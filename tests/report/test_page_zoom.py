"""Zooming and panning of charts in a browser: wheel, drag and the button Reset."""

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


def zoom_in(tab, key):
    """Zoom in about the middle of a chart."""
    box = tab.locator(PLOT.format(key)).bounding_box()
    tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -100)
    tab.keyboard.up("Control")
    tab.wait_for_timeout(100)


@pytest.mark.parametrize("key", ["scatter", "observed", "error"])
def test_a_button_resets_the_view(show, key):
    tab = show(study_page())
    full = visible_ranges(tab, key)
    tab.locator(PLOT.format(key)).scroll_into_view_if_needed()
    zoom_in(tab, key)
    for (low, high), (first, last) in zip(visible_ranges(tab, key), full, strict=True):
        assert first < low < high < last
    tool_buttons(tab, key).first.click()
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
    tool_buttons(tab, "drift").first.click()
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
