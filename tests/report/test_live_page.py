"""Live view in a browser: sliders move the drawing, errors are sentences, runs are animated."""

from typing import Literal

import pytest
from mechanisms import rope_swing
from pages import find_violations, open_tab

import beamdae as bd


@bd.model(t_end=0.2)
def swing(length=0.5, mass=2.0):
    """Release a `mass` [kg] on a rope of `length` [m]."""
    return rope_swing(length, mass)


@pytest.fixture
def live():
    live = swing.view()
    yield live
    live.close()


@pytest.fixture
def open_live(browser, live):
    """Return a function that opens the live view in a window of this size and color scheme."""
    contexts, messages, requests = [], [], []

    def show(**settings):
        context = browser.new_context(**settings)
        contexts.append(context)
        tab = open_tab(context, live.url, messages, requests)
        wait_for_run(tab)
        return tab

    yield show
    for context in contexts:
        context.close()
    # The browser reports requests to a closed server.
    assert [x for x in messages if "ERR_CONNECTION_REFUSED" not in x] == []
    assert all(url.startswith((live.url, "data:")) for url in requests)


def wait_for_run(tab):
    tab.locator("#state", has_text=" steps, ").wait_for()


def stage(tab):
    paths = tab.locator("#stage path.body:not(.initial)")
    return paths.evaluate_all("paths => paths.map((path) => path.getAttribute('d'))")


def wait_for_drawing(tab, before):
    """Wait until the drawing differs from the one before."""
    for _ in range(500):
        if stage(tab) != before:
            return
        tab.wait_for_timeout(20)
    pytest.fail("the drawing did not change")


def test_a_slider_moves_the_drawing_and_its_release_runs_the_model(open_live):
    tab = open_live(viewport={"width": 1366, "height": 768})
    assert tab.locator("#title").text_content() == "swing"
    assert tab.locator("#play").text_content() == "Pause"
    tab.get_by_label("run after each change").uncheck()
    tab.locator("#play").click()
    field, slider = tab.locator("#parameter-length"), tab.get_by_role("slider", name="length")
    slider.focus()
    for _ in range(3):
        before = stage(tab)
        tab.keyboard.press("PageUp")
        wait_for_drawing(tab, before)
    assert 0.5 < float(field.input_value()) < 2.0
    assert tab.locator("#player").is_hidden()
    assert "--set length=" in tab.locator("#command").text_content()
    tab.get_by_label("run after each change").check()
    tab.keyboard.press("Tab")
    slider.focus()
    tab.keyboard.press("PageUp")
    wait_for_run(tab)
    assert tab.locator("#player").is_visible()
    assert tab.locator("#table tbody tr").count() == 4


def test_mistakes_and_units_in_a_field(open_live):
    tab = open_live(viewport={"width": 390, "height": 844}, color_scheme="dark")
    field, state = tab.locator("#parameter-length"), tab.locator("#state")
    before = stage(tab)
    field.fill("3 N")
    field.press("Enter")
    tab.locator("#state", has_text="the unit N measures another quantity").wait_for()
    assert "alarm" in state.get_attribute("class")
    field.fill("800 mm")
    field.press("Enter")
    wait_for_run(tab)
    assert "alarm" not in (state.get_attribute("class") or "")
    assert stage(tab) != before
    tab.locator("#reset").click()
    assert field.input_value() == "0.5"
    assert tab.locator("#command").is_hidden()
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390


@bd.model(t_end=0.1)
def rod(end: Literal["free", "long rope"] = "free"):
    """Hang a mass."""
    return swing(length=0.5 if end == "free" else 1.0)


def test_texts_with_known_values_are_chosen_from_a_list(browser):
    live = rod.view()
    context = browser.new_context(viewport={"width": 390, "height": 844}, bypass_csp=True)
    tab = context.new_page()
    tab.goto(live.url)
    wait_for_run(tab)
    before = stage(tab)
    tab.get_by_label("end", exact=True).select_option("long rope")
    wait_for_run(tab)
    wait_for_drawing(tab, before)
    assert "--set 'end=long rope'" in tab.locator("#command").text_content()
    assert find_violations(tab) == []
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    tab.locator("#reset").click()
    assert tab.get_by_label("end", exact=True).input_value() == "free"
    context.close()
    live.close()


def test_a_closed_server_is_a_sentence(open_live, live):
    tab = open_live(viewport={"width": 1366, "height": 768})
    live.close()
    tab.locator("#run").click()
    tab.locator("#state", has_text="The server does not answer").wait_for()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_live_view_has_no_violations(browser, live, scheme):
    # Axe is a script, which the policy of the page forbids.
    size = {"width": 390, "height": 844}
    context = browser.new_context(viewport=size, color_scheme=scheme, bypass_csp=True)
    tab = context.new_page()
    tab.goto(live.url)
    wait_for_run(tab)
    assert find_violations(tab) == []
    # The last column of the results was beyond the edge of the screen.
    overflow = "(box) => box.scrollWidth - box.clientWidth"
    assert tab.locator("#results .scroll").evaluate(overflow) == 0
    context.close()
