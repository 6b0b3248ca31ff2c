"""Accessibility of pages, tested by axe-core."""

import pytest
from pages import find_violations, study_page, sweep_page

import beamdae as bd
from beamdae.report.analysis_pages import build_modes_page


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
    tab.locator(".run").first.focus()
    assert find_violations(tab) == []


def test_pages_of_modes_have_no_violations(show):
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0)))
    for name, anchor in (("left", (0.0, 0.0)), ("lower", (1.0, -1.0))):
        mech.add(bd.Spring(name, mech.ground.at(*anchor), mass.point, 100.0))
    assert find_violations(show(build_modes_page(bd.modes(mech), "modes"))) == []


def test_pages_on_a_phone_have_no_violations(phone):
    assert find_violations(phone(sweep_page())) == []
