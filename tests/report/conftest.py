"""Fixtures that open pages in a browser."""

import shutil

import pytest
from pages import open_tab

from beamdae.report.page.page_file import write_page

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
REQUIREMENT = "it needs Debian's package chromium and Python's playwright"


@pytest.fixture(scope="module")
def browser():
    api = pytest.importorskip("playwright.sync_api", reason=REQUIREMENT)
    if CHROMIUM is None:
        pytest.skip(REQUIREMENT)
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser, tmp_path):
    """Return a function that opens a page in a tab, given by its data or a result that has one.

    After the test, the console must be empty and no other address may have been requested.
    """
    messages, requests, contexts = [], [], []

    def show(page, **settings):
        path = tmp_path / "page.html"
        write_page(path, page) if isinstance(page, dict) else page.page(path)
        context = browser.new_context(**settings)
        context.set_default_navigation_timeout(120_000)  # of a busy machine
        contexts.append(context)
        return open_tab(context, path.as_uri(), messages, requests)

    yield show
    for context in contexts:
        context.close()
    assert messages == []
    # Files saved by the page are blobs.
    addresses = {url for url in requests if not url.startswith("blob:")}
    assert addresses == {(tmp_path / "page.html").as_uri()}


@pytest.fixture
def show(open_page):
    """Return a function that opens a page in the window of a laptop."""
    return lambda page: open_page(page, viewport={"width": 1366, "height": 768})


@pytest.fixture
def phone(open_page):
    """Return a function that opens a page on the touch screen of an upright phone."""
    screen = {"width": 390, "height": 844}
    return lambda page: open_page(page, viewport=screen, has_touch=True, is_mobile=True)
