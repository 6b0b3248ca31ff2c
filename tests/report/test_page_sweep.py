"""The page of a sweep in a browser: sliders, colors, and cases without curves."""

import re

import numpy as np
from numpy.testing import assert_allclose
from pages import (
    find_row,
    sweep_page,
)


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
