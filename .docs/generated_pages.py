"""Pages written at each build: the reference from the catalog, the map from module docstrings."""

import ast
import csv
import re
from itertools import groupby
from pathlib import Path

import gallery_cards

from beamdae import catalog

COLOR_BAR_HEIGHT = 66  # below the drawing of an animation [px]
PACKAGE = Path(catalog.__file__).parent

NAMES = """```{{eval-rst}}
.. currentmodule:: beamdae

.. autosummary::
   :toctree: names
   :nosignatures:

{names}
```
"""


def write_reference(folder):
    """Write one page of the API reference for each page of the catalog."""
    for page, groups in groupby(catalog.GROUPS, key=lambda group: group.page):
        title, opening = catalog.PAGES[page]
        blocks = [f"# {title}\n", f"{opening}\n"]
        for group in groups:
            names = "\n".join(f"   {public.path}" for public in group.names)
            blocks += [f"## {group.heading}\n"] if group.heading else []
            blocks.append(NAMES.format(names=names))
        (folder / f"{page}.md").write_text("\n".join(blocks), "utf-8")


def write_map(path):
    """Write the map of the package from the docstrings of its folders and modules."""
    blocks = [MAP_HEADER]
    for folder in sorted({file.parent for file in PACKAGE.rglob("*.py")}, key=_reading_order):
        relative = folder.relative_to(PACKAGE.parent).as_posix()
        summary, *rest = _docstring(folder / "__init__.py").split("\n\n", 1)
        blocks.append(f"## `{relative}/`\n\n{summary}\n")
        blocks += [f"{text}\n" for text in _paragraphs("".join(rest))]
        rows = [
            f"| `{file.stem}` | {_cell(_docstring(file))} |"
            for file in sorted(folder.glob("*.py"))
            if file.stem != "__init__"
        ]
        if rows:
            blocks.append("\n".join(["| module | contents |", "|---|---|", *rows, ""]))
    path.write_text("\n".join(blocks), "utf-8")


MAP_HEADER = """# Map of the package

This page lists every folder and module of `beamdae/` with the summary of its docstring.
[Architecture](architecture.md) shows how the folders depend on each other.
"""


def _reading_order(folder):
    """Sort folders by path, the package itself first."""
    return folder.relative_to(PACKAGE).parts


def _docstring(file):
    return ast.get_docstring(ast.parse(file.read_text("utf-8"))) or ""


def _paragraphs(text):
    """Return the paragraphs of the text; "To extend:" begins one without an empty line."""
    return [" ".join(part.split()) for part in re.split(r"\n\n+|\n(?=To extend:)", text) if part]


def _cell(docstring):
    """Return the summary of a docstring as the cell of a table."""
    return " ".join(docstring.split("\n\n")[0].split()).replace("|", "\\|")


def write_scoreboard(path):
    """Write the outcomes that `validation/scoreboard.py` has stored, and all that are not right."""
    with (PACKAGE.parent / "validation" / "scoreboard.csv").open(encoding="utf-8") as file:
        cases = list(csv.DictReader(file))
    lines, departures = [], []
    for board, group in groupby(cases, key=lambda case: case["board"]):
        outcomes = list(group)
        verdicts = [case["verdict"] for case in outcomes]
        counts = [str(verdicts.count(verdict)) for verdict in VERDICTS]
        digits = min((float(case["digits"]) for case in outcomes if case["digits"]), default=None)
        worst = "" if digits is None else f"{digits:.1f}"
        lines.append(f"| {' | '.join([board, str(len(outcomes)), *counts, worst])} |")
        departures += [case for case in outcomes if case["verdict"] != "right"]
    rows = [
        f"| {x['board']} | {x['case']} | {x['verdict']} | {_cell(x['reason'])} |"
        for x in departures
    ]
    page = [SCOREBOARD_HEADER, *lines, DEPARTURES_HEADER, *rows, ""]
    path.write_text("\n".join(page), "utf-8")


VERDICTS = ("right", "wrong", "missed", "false")
SCOREBOARD_HEADER = """# Scoreboard

`validation/scoreboard.py` compares beamdae with external and refined answers, and must not get
worse. "missed" counts answers and statements that are not given, "false" those that should not be
given, and "wrong" all others; "digits" are those of the worst value. `validation/README.md`
describes the boards.

| board | cases | right | wrong | missed | false | digits |
|---|---|---|---|---|---|---|"""
DEPARTURES_HEADER = """
## Cases that are not right

| board | case | verdict | reason |
|---|---|---|---|"""


def write_words(path, words):
    """Write the page that lists the words of each page."""
    rows = [f"| {', '.join(entries)} | []({page}.md) |" for page, entries in words.items()]
    path.write_text("\n".join([WORDS_HEADER, *rows, ""]), "utf-8")


WORDS_HEADER = """# Words

This page lists words that you may search for, and the pages that answer them. The search of this
site finds the same pages.

| you look for | page |
|---|---|"""


def write_motion(page, path):
    """Run the Python code printed on a page, and animate its run in a file."""
    _, _, text = page.read_text("utf-8").partition("```python\n")
    code = text.partition("```")[0].rstrip()
    *lines, last = code.splitlines()
    variables = {}
    exec("\n".join(lines), variables)
    # The last line of the page writes the same animation, with another name.
    assert last.startswith("run.animate("), last
    variables["run"].animate(path, color="stress", frames=75)
    gallery_cards.save_cropped(path, path, (460, 400), bottom=COLOR_BAR_HEIGHT)
