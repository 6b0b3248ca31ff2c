"""Accessibility of pages, tested by axe-core."""

from importlib.resources import files

import pytest
from pages import study_page, sweep_page

# In the package of PyPI, so that nothing is downloaded by a test.
SCRIPT = pytest.importorskip("axe_playwright_python", reason="it needs axe-playwright-python")
RUN = """async () => (await axe.run(document, {
    runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"],
    rules: {"label-content-name-mismatch": {enabled: true}, "target-size": {enabled: true}},
})).violations.map(({id, nodes}) => [id, nodes.map(({html}) => html).slice(0, 3)])"""


def find_violations(tab):
    tab.evaluate(files(SCRIPT).joinpath("axe.min.js").read_text(encoding="utf-8"))
    return tab.evaluate(RUN)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("page", [study_page, sweep_page], ids=["study", "sweep"])
def test_pages_have_no_violations(open_page, page, scheme):
    tab = open_page(page(), color_scheme=scheme, viewport={"width": 1366, "height": 768})
    assert find_violations(tab) == []


def test_pages_on_a_phone_have_no_violations(phone):
    assert find_violations(phone(sweep_page())) == []
