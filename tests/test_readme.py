"""Examples of the README and of the guide run as printed."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import beamdae as bd

ROOT = Path(__file__).parents[1]
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_modes_in_the_guide():
    names = run_page("modes")
    assert names["modes"].kinds == ("vibration",) * 4
    # Close to the frequency of a pendulum of the same length.
    assert 0.5 < names["modes"].frequencies[0] < 0.7
    assert names["response"].shape == (2, len(names["model"].outputs), 2)


@pytest.mark.slow
def test_arch_in_the_guide_snaps_through():
    names = run_page("equilibria")
    heights = names["jump"]["crown.y"]
    assert heights.iloc[0] == names["path"]["crown.y"].iloc[names["limit"].row]
    assert heights.min() < -5e-3


@pytest.mark.slow
def test_forces_in_the_guide():
    names = run_page("forces")
    solution = bd.simulate(names["mech"], bd.Ida(rtol=1e-4), t_end=0.3)
    assert solution.status.success
    assert solution.quality.energy_imbalance < 1e-2


@pytest.mark.slow
def test_events_in_the_guide():
    solution = run_page("events")["solution"]
    assert list(solution.events["event"]) == ["low", "tip.x crosses 0", "tip.x crosses -0.3"]
    assert solution.t[-1] == solution.events["t [s]"].iloc[-1] < 2.0


@pytest.mark.slow
def test_section_forces_in_the_guide():
    names = run_page("section_forces")
    # A rod between two hinges has no moment at its ends.
    table = names["forces"].envelope()
    np.testing.assert_allclose(table["M max [N m]"].iloc[[0, -1]], 0.0, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted(EXECUTED_PAGES - TESTED_PAGES))
def test_page_of_the_guide_runs_as_printed(page):
    assert run_page(page)
