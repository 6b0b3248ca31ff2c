"""Documentation pages run as printed: Python blocks and `beamdae` commands."""

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
# Dask leaves sockets open when a cluster shuts down on a busy machine.
allow_dask_warnings = pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::ResourceWarning"
)


def code_blocks(page):
    """Return (language, text) of each code block."""
    return [(kind.split()[-1], text) for kind, text in BLOCK.findall(page.read_text())]


def page_param(page):
    """Return a page as a parameter of a test."""
    has_cluster = "LocalCluster" in page.read_text()
    return pytest.param(page, marks=[allow_dask_warnings] if has_cluster else [], id=page.stem)


def run_page(page):
    """Execute a page from top to bottom; return the names it defines."""
    names = {"__name__": "__main__"}
    for k, (language, text) in enumerate(code_blocks(page)):
        if language == "python":
            exec(compile(text, f"{page.name}, block {k + 1}", "exec"), names)
            continue
        for line in text.splitlines():
            program, *arguments = shlex.split(line, comments=True)
            if program == "beamdae":
                run_command(line, arguments)
    return names


def run_command(line, arguments):
    """Run a command on an example; for other files, check that its options exist."""
    is_example = any(argument.startswith("example:") for argument in arguments)
    executed = arguments if is_example else [arguments[0], "--help"]
    result = CliRunner(env={"COLUMNS": "200"}).invoke(app, executed)
    assert result.exit_code == 0, f"{line}: {result.output}"
    options = [argument for argument in arguments if argument.startswith("--")]
    assert is_example or all(option in result.output for option in options), line


@slow
def test_tutorial_results_match_its_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_page(TUTORIAL)
    assert_allclose(names["modes"].frequencies, [2.81, 17.3, 63.4], rtol=2e-3)
    assert names["mech"].check(predict=False).rigid_mobility == 1
    assert names["run"].quality.energy_imbalance < 1e-5
    assert (tmp_path / "four_bar.gif").stat().st_size > 1e4
    assert np.ptp(names["run"]["pin.angle"]) == pytest.approx(0.36, abs=0.005)
    assert names["finer"].difference(names["run"], "pin.angle").abs().max().iloc[0] < 2e-5
    swings = names["results"].table["swing [rad]"]
    assert (names["results"].table["status"] == "ok").all()
    assert_allclose(swings.iloc[[0, 3, 6]], [0.341, 0.870, 1.461], rtol=2e-3)
    # Three standard deviations.
    assert abs(names["fit"].x[0] - 173.0) < 3.0 * names["deviation"]
    assert names["deviation"] < 0.1


@slow
@pytest.mark.parametrize("page", [page_param(page) for page in PAGES if code_blocks(page)])
def test_page_runs_as_printed(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_page(page)
    # Report resources that the page leaves open in this test, not in a later one.
    gc.collect()


def test_pages_with_cells_have_a_notebook_header():
    """Without the header, cells would be displayed but not executed."""
    for page in [TUTORIAL, *PAGES]:
        text = page.read_text()
        assert ("{code-cell}" in text) == text.startswith("---\njupytext:"), page.name
