"""Pages of the site: words of the search, cards of the gallery, code of the first screen."""

import ast
import importlib.util
import json
import re
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
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


@pytest.mark.slow(reason="reads the site, which CI builds before the slow tests")
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


@pytest.mark.slow(reason="simulates three seconds")
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


# Examples of the README and of the guide run as printed.

GUIDE = ROOT / ".docs" / "guide"
# Pages with a test of their results below.
TESTED_PAGES = {"equations", "equilibria", "events", "forces", "modes", "section_forces"}
EXECUTED_PAGES = {page.stem for page in GUIDE.glob("*.md") if "{code-cell}" in page.read_text()}


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    """Examples write files into the working directory, which stayed in the repository."""
    monkeypatch.chdir(tmp_path)


def code_blocks(text):
    return re.findall(r"```(?:python|\{code-cell\}(?: python)?)\n(.*?)```", text, flags=re.DOTALL)


def run_page(page):
    """Execute the code blocks of a page; return the names they define."""
    names: dict = {}
    for block in code_blocks((GUIDE / f"{page}.md").read_text()):
        exec(compile(block, f"{page}.md", "exec"), names)
    return names


@pytest.mark.slow(reason="a fifth of a second")
def test_example_runs_and_writes_its_table():
    section = (ROOT / "README.md").read_text().split("## A model")[1].split("\n## ")[0]
    (example,) = code_blocks(section)
    assert len([line for line in example.splitlines() if line.strip()]) <= 15
    exec(compile(example, "README.md", "exec"), {})
    table = pd.read_csv("results/pendulum.csv")
    assert table["t [s]"].iloc[-1] == 1.0
    assert {"tip.x [m]", "tip.angle [rad]", "gauge [-]"} <= set(table.columns)


def test_links_of_readme_and_pages_lead_to_files():
    for page in (ROOT / "README.md", *ROOT.glob(".docs/guide/*.md"), *ROOT.glob(".docs/*.md")):
        for target in re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", page.read_text()):
            # These pages are generated with the site.
            if not target.removeprefix("../").startswith(
                ("gallery/", "tutorials/", "develop/scoreboard.", "words.", "first_screen.")
            ):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_system_of_equations_in_the_guide():
    solution = run_page("equations")["solution"]
    assert list(solution.observed) == ["x [m]", "y [m]", "r [m]", "push [N]"]
    assert solution.coordinates().columns[-1] == "lam.constraint.rod [N]"
    # The rod starts horizontal and carries the weight.
    np.testing.assert_allclose(solution.observed["push [N]"].iloc[0], 0.2 * 9.81, rtol=1e-6)
    # The gravitational potential accounts for all power of f.
    np.testing.assert_allclose(solution.energies["energy.work_of_loads [J]"], 0.0, atol=1e-12)
    assert solution.quality.energy_imbalance < 100e-6


@pytest.mark.slow(reason="draws and animates modes")
def test_modes_in_the_guide():
    names = run_page("modes")
    assert names["modes"].kinds == ("vibration",) * 4
    # Close to the frequency of a pendulum of the same length.
    assert 0.5 < names["modes"].frequencies[0] < 0.7
    assert names["response"].shape == (2, len(names["model"].outputs), 2)


@pytest.mark.slow(reason="two seconds")
def test_arch_in_the_guide_snaps_through():
    names = run_page("equilibria")
    heights = names["jump"]["crown.y"]
    assert heights.iloc[0] == names["path"]["crown.y"].iloc[names["limit"].row]
    assert heights.min() < -5e-3


@pytest.mark.slow(reason="half a second and more")
def test_forces_in_the_guide():
    names = run_page("forces")
    solution = bd.simulate(names["mech"], bd.Ida(rtol=1e-4), t_end=0.3)
    assert solution.status.success
    assert solution.quality.energy_imbalance < 1e-2


@pytest.mark.slow(reason="a fifth of a second")
def test_events_in_the_guide():
    solution = run_page("events")["solution"]
    assert list(solution.events["event"]) == ["low", "tip.x crosses 0", "tip.x crosses -0.3"]
    assert solution.t[-1] == solution.events["t [s]"].iloc[-1] < 2.0


@pytest.mark.slow(reason="a run at a tight tolerance")
def test_section_forces_in_the_guide():
    names = run_page("section_forces")
    # A rod between two hinges has no moment at its ends.
    table = names["forces"].envelope()
    np.testing.assert_allclose(table["M max [N m]"].iloc[[0, -1]], 0.0, atol=1e-6)


@pytest.mark.slow(reason="writes animations")
@pytest.mark.parametrize("page", sorted(EXECUTED_PAGES - TESTED_PAGES))
def test_page_of_the_guide_runs_as_printed(page):
    assert run_page(page)
