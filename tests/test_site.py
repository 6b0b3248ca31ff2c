"""Pages of the site: words of the search, cards of the gallery, code of the first screen."""

import ast
import importlib.util
import json
import re
import sys
from collections import Counter
from pathlib import Path

import pytest

import beamdae as bd

ROOT = Path(__file__).parents[1]
DOCS = ROOT / ".docs"
BUILT_INDEX = ROOT / "results" / "docs" / "searchindex.js"


def load_page_module(name):
    """Import a module of the site, which is not part of the package."""
    spec = importlib.util.spec_from_file_location(f"site_{name}", DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def source_of(page):
    """Return the file of a page; tutorials are copied, and pages of models are generated."""
    folder, _, name = page.partition("/")
    if folder == "tutorials":
        return ROOT / "models" / "tutorials" / f"{name}.md"
    return ROOT / "models" / f"{name}.py" if folder == "gallery" else DOCS / f"{page}.md"


def test_words_of_the_search_belong_to_existing_pages():
    words = load_page_module("search_words").WORDS
    assert all(source_of(page).exists() for page in words), list(words)
    counts = Counter(word.lower() for entries in words.values() for word in entries)
    assert max(counts.values()) == 1, counts.most_common(3)
    searched = "pid controller matlab simulink export fmu parallel slow units gravity torque motor"
    searched += " spring damping contact friction csv animation stress fatigue buckling"
    assert {*searched.split(), "natural frequency", "initial velocity"} <= set(counts)


@pytest.mark.slow
def test_search_of_the_built_site_finds_the_page_of_each_word():
    if not BUILT_INDEX.exists():
        pytest.skip(f"{BUILT_INDEX} is missing; build the site")
    text = BUILT_INDEX.read_text("utf-8")
    index = json.loads(text[text.index("{") : text.rindex("}") + 1])
    for page, words in load_page_module("search_words").WORDS.items():
        for word in words:
            # Main entries with the words of the query come first, before titles and texts.
            entries = index["indexentries"].get(word.lower(), [])
            pages = [index["docnames"][number] for number, _, is_main in entries if is_main]
            assert pages == [page], word


def test_gallery_has_a_card_for_each_model_and_example():
    pytest.importorskip("PIL")
    cards = load_page_module("gallery_cards")
    models = {path.stem for path in (ROOT / "models").glob("*.py")}
    assert set(cards.MODEL_TAGS) == models
    tutorials = {path.stem for path in (ROOT / "models" / "tutorials").glob("*.md")}
    assert {f"tutorials/{name}" for name in tutorials} <= set(cards.EXAMPLES)
    entries = list(cards._entries())
    assert len(entries) >= 25
    for page, title, text, tags in entries:
        assert source_of(page).exists(), page
        assert title
        assert text
        assert tags
        assert "\n" not in text, page
    assert '<a class="gallery-card" href="../gallery/four_bar.html"' in cards._card(*entries[1])


def test_regression_no_line_of_a_page_is_a_comment_of_myst():
    """A line of a tutorial that began with a percent sign was missing from its page."""
    pages = [*DOCS.rglob("*.md"), *(ROOT / "models" / "tutorials").glob("*.md")]
    comments = []
    for page in pages:
        text = re.sub(
            r"^(```+).*?^\1$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE
        )
        comments += [(page.name, x) for x in text.splitlines() if x.lstrip().startswith("%")]
    # Descriptions of models are pages, too.
    for model in (ROOT / "models").glob("*.py"):
        lines = (ast.get_docstring(ast.parse(model.read_text("utf-8"))) or "").splitlines()
        comments += [(model.name, x) for x in lines if x.lstrip().startswith("%")]
    assert len(pages) > 40
    assert not comments


@pytest.mark.slow
def test_code_of_the_first_screen_runs():
    code = (DOCS / "index.md").read_text("utf-8").partition("```python\n")[2].partition("```")[0]
    lines = [line for line in code.splitlines() if line]
    assert len(lines) <= 13
    assert max(map(len, lines)) <= 58  # fits beside the picture
    variables = {}
    exec("\n".join(lines[:-1]), variables)
    assert re.match(r"run\.animate\(", lines[-1])
    assert variables["run"].status.kind == "ok"
    assert isinstance(variables["run"], bd.results.Solution)
