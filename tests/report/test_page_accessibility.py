"""Accessibility of pages, tested by axe-core."""

import pytest
from pages import find_violations, study_page, sweep_page


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
