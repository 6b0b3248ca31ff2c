"""Pages of the documentation run as printed: their Python, and their `beamdae` commands."""

import gc
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from beamdae.cli.app import app

ROOT = Path(__file__).parents[1]
TUTORIAL = ROOT / "models" / "tutorials" / "four_bar.md"
PAGES = [
    page for part in ("howto", "theory") for page in sorted((ROOT / ".docs" / part).glob("*.md"))
]
BLOCK = re.compile(r"^```(\{code-cell\} python|python|sh)\n(.*?)^```", re.DOTALL | re.MULTILINE)

slow = pytest.mark.slow(reason="pages simulate, fit and make moving pictures")
# Of a cluster that ends on a busy machine sockets are left, which is Dask's affair.
of_dask = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


def blocks(page):
    """Language and text of each block of code."""
    return [(kind.split()[-1], text) for kind, text in BLOCK.findall(page.read_text())]


def printed(page):
    """A page as a variant of a test."""
    has_cluster = "LocalCluster" in page.read_text()
    return pytest.param(page, marks=[of_dask] if has_cluster else [], id=page.stem)


def run(page):
    """Execute a page from top to bottom; the names it leaves."""
    names = {"__name__": "__main__"}
    for k, (language, text) in enumerate(blocks(page)):
        if language == "python":
            exec(compile(text, f"{page.name}, block {k + 1}", "exec"), names)
            continue
        for line in text.splitlines():
            program, *arguments = shlex.split(line, comments=True)
            if program == "beamdae":
                command(line, arguments)
    return names


def command(line, arguments):
    """Run a command of a model that is there; of others, look whether there are such options."""
    there = any(argument.startswith("example:") for argument in arguments)
    given = arguments if there else [arguments[0], "--help"]
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, given)
    assert result.exit_code == 0, f"{line}: {result.output}"
    options = [argument for argument in arguments if argument.startswith("--")]
    assert there or all(option in result.output for option in options), line


@slow
def test_the_tutorial_tells_what_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run(TUTORIAL)
    assert_allclose(names["modes"].frequencies, [2.81, 17.3, 63.4], rtol=2e-3)
    assert names["mech"].check(predict=False).rigid_mobility == 1
    assert names["run"].quality.energy_imbalance < 1e-5
    assert (tmp_path / "four_bar.gif").stat().st_size > 1e4
    assert np.ptp(names["run"]["pin.angle"]) == pytest.approx(0.36, abs=0.005)
    assert names["finer"].difference(names["run"], "pin.angle").abs().max().iloc[0] < 2e-5
    swings = names["found"].table["swing [rad]"]
    assert (names["found"].table["status"] == "ok").all()
    assert_allclose(swings.iloc[[0, 3, 6]], [0.341, 0.870, 1.461], rtol=2e-3)
    # Three standard deviations.
    assert abs(names["fit"].x[0] - 173.0) < 3.0 * names["deviation"]
    assert names["deviation"] < 0.1


@slow
@pytest.mark.parametrize("page", [printed(page) for page in PAGES if blocks(page)])
def test_a_page_runs_as_printed(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(page)
    # What a page leaves open is told in its own test.
    gc.collect()


def test_pages_are_notebooks_where_they_have_cells():
    """Without the header cells would be shown and not executed."""
    for page in [TUTORIAL, *PAGES]:
        text = page.read_text()
        assert ("{code-cell}" in text) == text.startswith("---\njupytext:"), page.name
