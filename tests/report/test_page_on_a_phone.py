"""The page in a small window that is touched, on a dark screen, and on paper."""

import pytest
from numpy.testing import assert_allclose
from pages import odd_names, place, point, seen, study, until

# Points of a screen a finger meets.
FINGER = 40


@pytest.mark.parametrize("page", [study, odd_names], ids=["study", "odd names"])
def test_nothing_overflows_sideways(phone, page):
    tab = phone(page())
    for number in (2, 5):
        tab.locator(f"#table tr[data-case='case {number}'] input").tap()
    assert tab.evaluate("document.documentElement.scrollWidth") == 390
    # The table goes on in itself.
    inside = "({scrollWidth, clientWidth}) => [scrollWidth, clientWidth]"
    whole, seen_of_it = tab.locator("#cases .scroll").evaluate(inside)
    assert seen_of_it < 390 < whole


def test_what_is_touched_is_as_large_as_a_finger(phone):
    tab = phone(study())
    size = "one => [one.textContent, one.getBoundingClientRect().height]"
    for one in tab.locator("button:visible, select:visible, input[type=search]:visible").all():
        text, height = one.evaluate(size)
        assert height >= FINGER, text


def test_letters_of_charts_are_as_large_as_elsewhere(phone):
    tab = phone(study())
    scale = """() => [...document.querySelectorAll('.plot')].map(
        (one) => one.getBoundingClientRect().width / one.viewBox.baseVal.width)"""
    assert_allclose(tab.evaluate(scale), 1.0, atol=0.01)
    tab.set_viewport_size({"width": 844, "height": 390})
    until(tab, "Math.abs(state.charts.get('scatter').width - 390) > 100")
    assert_allclose(tab.evaluate(scale), 1.0, atol=0.01)


def test_a_tap_reads_and_chooses(phone):
    tab = phone(study())
    tab.locator("[data-chart=observed] .plot").scroll_into_view_if_needed()
    tab.touchscreen.tap(*place(tab, "observed", 1.0, 0.0))
    said = tab.inner_text("#tip").split()
    assert float(said[2]) == pytest.approx(1.0, abs=0.02)
    assert tab.locator("[data-chart=observed] .dot").count() == 1
    before = tab.locator("tr.selected").count()
    point(tab, 2).tap()
    assert tab.locator("tr.selected").count() == before + 1
    assert "Ida(rtol=0.001)" in tab.inner_text("#tip")


def touching(tab):
    """Put fingers where they are told, or lift them."""
    session = tab.context.new_cdp_session(tab)

    def fingers(kind, *places):
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
        session.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})

    return fingers


def test_two_fingers_zoom_and_one_moves_what_is_zoomed(phone):
    tab = phone(study())
    fingers = touching(tab)
    left, right = place(tab, "observed", 0.5, 0.0), place(tab, "observed", 1.5, 0.0)
    middle = [(a + b) / 2 for a, b in zip(left, right, strict=True)]
    quarter = (right[0] - left[0]) / 4
    fingers("Start", [middle[0] - quarter, left[1]], [middle[0] + quarter, left[1]])
    fingers("Move", left, right)
    fingers("End")
    until(tab, "state.views.observed.x !== null")
    begin, end = seen(tab, "observed")[0]
    # Fingers go twice as far apart.
    assert_allclose([end - begin, begin + end], [1.0, 2.0], atol=0.06)
    one = place(tab, "observed", 1.0, 0.0)
    fingers("Start", one)
    for k in (1, 2, 3, 4):
        fingers("Move", [one[0] + 15 * k, one[1]])
    fingers("End")
    moved = seen(tab, "observed")[0]
    assert moved[0] < begin - 0.05
    assert_allclose(moved[1] - moved[0], end - begin)


def test_dark_screens_and_paper(open_page):
    tab = open_page(study(), color_scheme="dark")
    color = "getComputedStyle(document.body).backgroundColor"
    assert tab.evaluate(color) == "rgb(21, 24, 28)"
    curve = "getComputedStyle(document.querySelector('.plot path.curve')).stroke"
    assert tab.evaluate(curve) == "rgb(61, 159, 219)"
    tab.emulate_media(media="print")
    assert tab.evaluate(color) == "rgb(255, 255, 255)"
    assert not tab.locator(".tools").first.is_visible()
    assert tab.locator(".plot").first.is_visible()
