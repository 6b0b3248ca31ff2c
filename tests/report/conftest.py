"""A browser, which opens pages."""

import shutil

import pytest

from beamdae.report.page.page import write_page

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
NEEDED = "it needs Debian's package chromium and Python's playwright"


@pytest.fixture(scope="module")
def browser():
    api = pytest.importorskip("playwright.sync_api", reason=NEEDED)
    if CHROMIUM is None:
        pytest.skip(NEEDED)
    with api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def show(browser, tmp_path):
    """Open a page; at the end, nothing may have been complained of or loaded from elsewhere."""
    complaints, loaded = [], []
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(5000)
    tab = context.new_page()
    tab.on("console", lambda message: complaints.append(message.text))
    tab.on("pageerror", lambda problem: complaints.append(str(problem)))
    tab.on("request", lambda request: loaded.append(request.url))

    def shown(page):
        path = write_page(tmp_path / "page.html", page)
        tab.goto(path.as_uri())
        return tab

    yield shown
    context.close()
    assert complaints == []
    assert loaded == [(tmp_path / "page.html").as_uri()]
