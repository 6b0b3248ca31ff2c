"""Views of charts in a browser: wheel, drag, keys and buttons."""

import numpy as np
from numpy.testing import assert_allclose
from pages import buttons, place, point, row, seen, study, until

PLOT = "[data-chart={}] .plot"
# Of places that are known to a pixel.
PIXEL = 0.01


def test_buttons_zoom_and_reset(show):
    tab = show(study())
    for key in ("scatter", "observed", "error"):
        whole = seen(tab, key)
        larger, smaller, reset = (buttons(tab, key).nth(k) for k in range(3))
        assert reset.is_disabled()
        larger.click()
        for near, far, log in zip(seen(tab, key), whole, logarithmic(key), strict=True):
            low, high, first, last = (np.log10 if log else np.asarray)([*near, *far])
            assert_allclose([high - low, high + low], [(last - first) / 1.5, last + first])
        smaller.click()
        assert_allclose(seen(tab, key), whole, atol=1e-12)
        smaller.click()
        reset.click()
        assert seen(tab, key) == whole
        assert reset.is_disabled()


def logarithmic(key):
    return {"scatter": (True, True), "error": (False, True)}.get(key, (False, False))


def test_zooming_ends_where_there_is_nothing_more(show):
    tab = show(study())
    for k, least, most in ((0, 1e-4, 2e-4), (1, 2.0, 4.0)):
        tab.locator(PLOT.format("observed")).press("0")
        (first, last), _ = seen(tab, "observed")
        for _ in range(40):
            buttons(tab, "observed").nth(k).click()
        (low, high), _ = seen(tab, "observed")
        assert least <= (high - low) / (last - first) <= most


def test_the_wheel_is_the_pages_until_a_chart_has_the_focus(show):
    tab = show(study())
    tab.mouse.move(*place(tab, "observed", 0.5, 0.0))
    whole, at = seen(tab, "observed"), tab.evaluate("scrollY")
    tab.mouse.wheel(0, 10)
    until(tab, f"scrollY > {at}")
    assert seen(tab, "observed") == whole
    tab.mouse.move(*place(tab, "observed", 0.5, 0.0))
    at = tab.evaluate("scrollY")
    tab.locator(PLOT.format("observed")).focus()
    tab.mouse.wheel(0, -100)
    until(tab, "state.views.observed.x !== null")
    (begin, end), (low, high) = seen(tab, "observed")
    # About the pointer.
    shrunk = np.exp(-0.25)
    assert_allclose([begin, end], [0.5 - 0.5 * shrunk, 0.5 + 1.5 * shrunk], atol=PIXEL)
    assert_allclose([low, high], np.array([-1.1, 1.1]) * shrunk, atol=PIXEL)
    assert tab.evaluate("scrollY") == at


def test_the_wheel_with_control_zooms_beside_an_axis_along_it_alone(show):
    tab = show(study())
    below = place(tab, "observed", 1.0, -1.25)
    tab.mouse.move(*below)
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -100)
    tab.keyboard.up("Control")
    until(tab, "state.views.observed.x !== null")
    assert tab.evaluate("state.views.observed.y") is None
    assert_allclose(seen(tab, "observed")[0], 1.0 + np.array([-1, 1]) * np.exp(-0.25), atol=PIXEL)


def dragged(tab, start, end):
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*np.mean([start, end], axis=0))
    tab.mouse.move(*end)
    tab.mouse.up()


def test_dragging_moves_and_a_double_click_shows_all(show):
    tab = show(study())
    whole = seen(tab, "observed")
    dragged(tab, place(tab, "observed", 1.0, 0.0), place(tab, "observed", 0.5, 0.5))
    (begin, end), (low, high) = seen(tab, "observed")
    assert_allclose([begin, end, low, high], [0.5, 2.5, -1.6, 0.6], atol=PIXEL)
    tab.mouse.dblclick(*place(tab, "observed", 1.0, 0.0))
    assert seen(tab, "observed") == whole


def test_shift_and_dragging_zooms_into_a_box(show):
    tab = show(study())
    start, end = place(tab, "observed", 0.5, 0.5), place(tab, "observed", 1.0, -0.5)
    tab.keyboard.down("Shift")
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*end)
    assert tab.locator(".zoom-box").count() == 1
    tab.mouse.up()
    tab.keyboard.up("Shift")
    assert_allclose(seen(tab, "observed"), [(0.5, 1.0), (-0.5, 0.5)], atol=PIXEL)
    assert tab.locator(".zoom-box").count() == 0


def test_a_drag_that_ends_on_a_point_selects_nothing(show):
    tab = show(study())
    before = tab.locator("tr.selected").count()
    box = point(tab, 2).bounding_box()
    start = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    dragged(tab, start, [start[0] + 60.0, start[1] + 20.0])
    assert tab.locator("tr.selected").count() == before
    assert_allclose(point(tab, 2).bounding_box()["x"], box["x"] + 60.0, atol=1.0)
    point(tab, 2).click()
    assert tab.locator("tr.selected").count() == before + 1


def test_keys_zoom_move_and_reset(show):
    tab = show(study())
    whole = seen(tab, "observed")
    tab.locator(PLOT.format("observed")).focus()
    tab.keyboard.press("+")
    assert_allclose(seen(tab, "observed")[0], [1 / 3, 5 / 3])
    tab.keyboard.press("Shift+ArrowRight")
    assert_allclose(seen(tab, "observed")[0], np.array([1 / 3, 5 / 3]) + 2 / 15)
    tab.keyboard.press("-")
    tab.keyboard.press("0")
    assert seen(tab, "observed") == whole


def test_a_point_keeps_the_focus_while_keys_zoom(show):
    tab = show(study())
    point(tab, 2).focus()
    tab.keyboard.press("+")
    assert tab.evaluate("document.activeElement.dataset.case") == "case 2"


def test_all_panels_show_the_same_time(show):
    tab = show(study())
    buttons(tab, "observed").first.click()
    times = [seen(tab, key)[0] for key in ("observed", "error", "energy", "drift")]
    assert_allclose(times, [[1 / 3, 5 / 3]] * 4)
    buttons(tab, "drift").nth(2).click()
    assert seen(tab, "observed")[0] == (0.0, 2.0)
    # Each keeps what it shows of its own values.
    assert tab.evaluate("state.views.observed.y") is not None


def test_a_view_stays_when_cases_are_added_and_goes_with_another_quantity(show):
    tab = show(study())
    buttons(tab, "observed").first.click()
    near = seen(tab, "observed")
    row(tab, 5).locator("td.label").click()
    assert seen(tab, "observed") == near
    tab.get_by_label("Observed: which").select_option("hinge.F [N]")
    times, values = seen(tab, "observed")
    assert times == near[0]
    assert values[0] > 4.0
