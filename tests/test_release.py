"""Metadata, recipe and paper agree with the package and with the stored results."""

import json
import re
import tomllib
from pathlib import Path

import pandas as pd
import pytest

import beamdae as bd

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "validation"
PAPER = ROOT / ".docs" / "paper"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def text_of(path):
    """Return the text of a page as one line."""
    return " ".join(path.read_text("utf-8").split())


def to_range(values, digits=2):
    return f"{values.min():.{digits}f} to {values.max():.{digits}f}"


def test_versions_agree():
    citation = re.search(r"^version: (\S+)", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    recipe = (ROOT / ".conda" / "meta.yaml").read_text("utf-8")
    conda = re.search(r'set version = "([^"]+)"', recipe)
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert {PROJECT["version"], citation[1], conda[1]} == {bd.__version__}
    assert f"## {bd.__version__}" in changes


def test_conda_recipe_has_the_dependencies_of_the_package():
    recipe = (ROOT / ".conda" / "meta.yaml").read_text("utf-8")
    host, run = recipe.partition("  host:\n")[2].partition("  run:\n")[::2]
    everywhere = [text for text in PROJECT["dependencies"] if ";" not in text]
    expected = {text.replace("matplotlib>", "matplotlib-base>") for text in everywhere}
    expected.add(f"python{PROJECT['requires-python']}")
    for section, extra in ((host, {"pip", "hatchling>=1.24"}), (run.partition("\n\n")[0], set())):
        lines = {line.strip(" -").replace(" ", "") for line in section.splitlines()}
        assert lines - {""} == expected | extra


def test_metadata_is_complete():
    # ECharts, which draws the charts of pages, has the other licenses.
    assert PROJECT["license"] == "MIT AND Apache-2.0 AND BSD-3-Clause"
    assert {"Paper"} <= set(PROJECT["urls"])
    assert {f"Programming Language :: Python :: 3.{k}" for k in (11, 12, 13)} <= set(
        PROJECT["classifiers"]
    )
    assert {"multibody dynamics", "curved beam"} <= set(PROJECT["keywords"])


def test_citations_of_the_paper_have_entries():
    text = (PAPER / "paper.md").read_text("utf-8").partition("\n---\n")[2]
    entries = set(re.findall(r"^@\w+\{(\w+),", (PAPER / "paper.bib").read_text(), re.MULTILINE))
    assert set(re.findall(r"@(\w+)", text)) == entries
    headings = re.findall(r"^# (.+)$", text, re.MULTILINE)
    assert {"Summary", "Statement of need", "State of the field", "References"} <= set(headings)


@pytest.mark.parametrize("page", [PAPER / "paper.md", ROOT / ".docs" / "comparison.md"])
def test_times_relative_to_exudyn_are_those_of_the_stored_tables(page):
    text = text_of(page)
    folder = RESULTS / "performance" / "results"
    frames = pd.read_csv(folder / "work_precision_best.csv")
    exact = pd.read_csv(folder / "work_precision_exact_best.csv")
    setup = frames["ratio with setup"]
    assert f"{setup.min():.2f} to {setup.max():.1f}" in text
    if page.stem == "paper":
        assert f"{to_range(frames['ratio'])} times as long as in Exudyn" in text
        assert f"{to_range(exact['ratio'])} times" in text
    else:
        for level in (1.0, 0.1, 0.01):
            ratios = [table["ratio"][table["level [mm]"] == level] for table in (frames, exact)]
            assert f"| {to_range(ratios[0])} | {to_range(ratios[1])} |" in text, level
    static = pd.read_csv(folder / "static_times.csv")
    static = static[static["steps asked"] == 10]
    for elements in (8, 256):
        ratio = static["ratio"][static["elements"] == elements]
        assert to_range(ratio, digits=1) in text, elements


def test_numbers_of_the_paper_are_those_of_the_stored_tables():
    text = text_of(PAPER / "paper.md")
    confirmations = json.loads((RESULTS / "record" / "confirmations.json").read_text())
    assert len(confirmations) == 36
    codes = pd.DataFrame(code for x in confirmations.values() for code in x["codes"])
    agrees = (codes["largest"] <= 1e-4).groupby(codes["tool"]).sum()
    assert f"from `beamdae` in {agrees['beamdae']} of them" in text
    assert f"from Exudyn in {agrees['exudyn']}." in text
    claims = pd.read_csv(RESULTS / "pan_liu_2012" / "results" / "summary.csv")["verdict"]
    counts = claims.value_counts()
    words = {
        "agrees": "agree,",
        "agrees in direction": "agree in direction",
        "differs in size": "differs in size",
        "differs": "differ,",
        "cannot be decided": "cannot be decided",
        "by construction": "hold by construction",
    }
    assert set(counts.index) == set(words)
    assert f"judges {len(claims)} claims" in text
    assert all(f"{counts[verdict]} {phrase}" in text for verdict, phrase in words.items())
    scoreboard = pd.read_csv(RESULTS / "scoreboard.csv")
    verdicts = scoreboard["verdict"][scoreboard["board"] == "error statements"]
    assert f"In {(verdicts == 'right').sum()} of {len(verdicts)} runs of" in text
