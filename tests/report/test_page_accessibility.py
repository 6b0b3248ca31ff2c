"""Accessibility of pages, tested by axe-core."""

from importlib.resources import files

import pytest
from pages import study_page, sweep_page

import beamdae as bd
from beamdae.report.analysis_pages import build_modes_page

# In the package of PyPI, so that nothing is downloaded by a test.
SCRIPT = pytest.importorskip("axe_playwright_python", reason="it needs axe-playwright-python")
RUN = """async () => (await axe.run(document, {
    runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"],
    rules: {"label-content-name-mismatch": {enabled: true}, "target-size": {enabled: true}},
})).violations.map(({id, nodes}) => [id, nodes.map(({html}) => html).slice(0, 3)])"""


def selected_page():
    """Return a sweep with ten selected cases, some of them failed or without curves."""
    page = sweep_page(without={4})
    page["cases"][5] |= {"status": "Newton did not converge", "limited": True}
    return page


def find_violations(tab):
    tab.evaluate(files(SCRIPT).joinpath("axe.min.js").read_text(encoding="utf-8"))
    return tab.evaluate(RUN)


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
