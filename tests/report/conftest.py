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
def opened(browser, tmp_path):
    """Open pages in tabs; at the end, nothing may have been complained of or loaded."""
    complaints, loaded, contexts = [], [], []

    def show(page, **settings):
        path = write_page(tmp_path / "page.html", page)
        context = browser.new_context(**settings)
        contexts.append(context)
        tab = context.new_page()
        tab.on("console", lambda message: complaints.append(message.text))
        tab.on("pageerror", lambda problem: complaints.append(str(problem)))
        tab.on("request", lambda request: loaded.append(request.url))
        tab.goto(path.as_uri())
        return tab

    yield show
    for context in contexts:
        context.close()
    assert complaints == []
    # Pictures that are saved are drawn from what the page itself holds.
    from_elsewhere = [url for url in loaded if not url.startswith("blob:")]
    assert set(from_elsewhere) == {(tmp_path / "page.html").as_uri()}


@pytest.fixture
def show(opened):
    """Open a page in a window of a laptop."""
    return lambda page: opened(page, viewport={"width": 1366, "height": 768})


@pytest.fixture
def phone(opened):
    """Open a page on a phone, which is held upright and touched."""
    screen = {"width": 390, "height": 844}
    return lambda page: opened(page, viewport=screen, has_touch=True, is_mobile=True)
