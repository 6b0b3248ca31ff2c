"""What the readme and the pages of the guide print runs as printed."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import beamdae as bd

ROOT = Path(__file__).parents[1]
GUIDE = ROOT / ".docs" / "guide"
# Pages whose results are looked at one by one below.
LOOKED_AT = {"equations", "equilibria", "events", "forces", "modes", "section_forces"}
RUN = {page.stem for page in GUIDE.glob("*.md") if "{code-cell}" in page.read_text()}


def blocks(text):
    return re.findall(r"```(?:python|\{code-cell\})\n(.*?)```", text, flags=re.DOTALL)


def names_of(page):
    """What the blocks of a page leave behind."""
    given: dict = {}
    for block in blocks((GUIDE / f"{page}.md").read_text()):
        exec(compile(block, f"{page}.md", "exec"), given)
    return given


def test_example_runs_and_writes_its_table(tmp_path, monkeypatch):
    section = (ROOT / "README.md").read_text().split("## A model")[1].split("\n## ")[0]
    (example,) = blocks(section)
    assert len([line for line in example.splitlines() if line.strip()]) <= 15
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "README.md", "exec"), {})
    table = pd.read_csv("results/pendulum.csv")
    assert table["t [s]"].iloc[-1] == 1.0
    assert {"tip.x [m]", "tip.angle [rad]", "gauge [-]"} <= set(table.columns)


def test_the_readme_leads_to_files_that_exist():
    for page in (ROOT / "README.md", *ROOT.glob(".docs/guide/*.md"), *ROOT.glob(".docs/*.md")):
        for target in re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", page.read_text()):
            # Made when the pages are.
            if not target.removeprefix("../").startswith("gallery/"):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_system_of_equations_runs_as_printed():
    solution = names_of("equations")["solution"]
    assert list(solution.observed) == ["x [m]", "y [m]", "r [m]", "push [N]"]
    assert solution.coordinates().columns[-1] == "lam.constraint.rod [N]"
    # The rod begins level: it carries the weight.
    np.testing.assert_allclose(solution.observed["push [N]"].iloc[0], 0.2 * 9.81, rtol=1e-6)
    # A gravitational potential leaves nothing to be a load.
    np.testing.assert_allclose(solution.ledger["energy.work_of_loads [J]"], 0.0, atol=1e-12)
    assert solution.quality.energy_imbalance < 100e-6


@pytest.mark.slow(reason="pictures of modes")
def test_modes_of_the_guide():
    names = names_of("modes")
    assert names["modes"].kinds == ("vibration",) * 4
    # Hanging, as a pendulum of its length nearly does.
    assert 0.5 < names["modes"].frequencies[0] < 0.7
    assert names["response"].shape == (2, len(names["model"].outputs), 2)


def test_the_arch_jumps_as_printed():
    names = names_of("equilibria")
    heights = names["jump"]["crown.y"]
    assert heights.iloc[0] == names["path"]["crown.y"].iloc[names["limit"].row]
    assert heights.min() < -5e-3


def test_forces_join_the_example():
    names = names_of("forces")
    solution = bd.simulate(names["mech"], bd.Ida(rtol=1e-4), t_end=0.3)
    assert solution.status.success
    assert solution.quality.energy_imbalance < 1e-2


def test_events_of_the_guide():
    solution = names_of("events")["solution"]
    assert list(solution.events["event"]) == ["low", "tip.x crosses 0", "tip.x crosses -0.3"]
    assert solution.t[-1] == solution.events["t [s]"].iloc[-1] < 2.0


@pytest.mark.slow(reason="a run at a tight tolerance")
def test_section_forces_of_the_guide():
    names = names_of("section_forces")
    # A rod between two hinges carries no moment at its ends.
    table = names["forces"].envelope()
    np.testing.assert_allclose(table["M max [N m]"].iloc[[0, -1]], 0.0, atol=1e-6)


@pytest.mark.slow(reason="moving pictures")
@pytest.mark.parametrize("page", sorted(RUN - LOOKED_AT))
def test_pages_run_as_printed(page):
    assert names_of(page)
