"""The README's example runs as printed."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import beamdae as bd


def test_example_runs_and_writes_its_table(tmp_path, monkeypatch):
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    section = readme.split("## A model")[1].split("\n## ")[0]
    (example,) = re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL)
    assert len([line for line in example.splitlines() if line.strip()]) <= 15
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "README.md", "exec"), {})
    table = pd.read_csv("results/pendulum.csv")
    assert table["t [s]"].iloc[-1] == 1.0
    assert {"tip.x [m]", "tip.angle [rad]", "gauge [-]"} <= set(table.columns)


def test_the_system_of_equations_runs_as_printed():
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    section = readme.split("## Equations of one's own")[1].split("\n## ")[0]
    (example,) = re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL)
    given = {}
    exec(compile(example, "README.md", "exec"), given)
    solution = given["solution"]
    assert list(solution.observed) == ["x [m]", "y [m]", "r [m]", "push [N]"]
    assert solution.coordinates().columns[-1] == "lam.constraint.rod [N]"
    # The rod begins level: it carries the weight.
    np.testing.assert_allclose(solution.observed["push [N]"].iloc[0], 0.2 * 9.81, rtol=1e-6)
    # A gravitational potential leaves nothing to be a load.
    np.testing.assert_allclose(solution.ledger["energy.work_of_loads [J]"], 0.0, atol=1e-12)
    assert solution.quality.energy_imbalance < 100e-6


@pytest.mark.slow(reason="moving pictures")
def test_modes_of_the_example(tmp_path, monkeypatch):
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    (model,) = re.findall(r"## A model\n.*?```python\n(.*?)```", readme, flags=re.DOTALL)
    section = readme.split("## Modes and linear models")[1].split("\n## ")[0]
    (modes,) = re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    # One frame shows what it writes.
    modes = modes.replace('mode_2.gif")', 'mode_2.gif", frames=2)')
    exec(model.split("solution =")[0] + modes, names)
    assert {file.name for file in Path("results").iterdir()} == {"modes.png", "mode_2.gif"}
    assert names["found"].kinds == ("vibration",) * 4
    # Hanging, as a pendulum of its length nearly does.
    assert 0.5 < names["found"].frequencies[0] < 0.7
    assert names["response"].shape == (2, len(names["model"].outputs), 2)


def test_the_arch_jumps_as_printed(tmp_path, monkeypatch):
    root = Path(__file__).parents[1]
    section = (root / "README.md").read_text().split("## Equilibria")[1].split("\n## ")[0]
    (example,) = re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL)
    assert len(example.splitlines()) == 5
    monkeypatch.chdir(tmp_path)
    (tmp_path / "models").symlink_to(root / "models")
    given = {"bd": bd}
    exec(compile(example, "README.md", "exec"), given)
    heights = given["jump"]["crown.y"]
    assert heights.iloc[0] == given["path"]["crown.y"].iloc[given["limit"].row]
    assert heights.min() < -5e-3
    assert (tmp_path / "snap.png").exists()


def test_forces_join_the_example():
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    (model,) = re.findall(r"## A model\n.*?```python\n(.*?)```", readme, flags=re.DOTALL)
    (forces,) = re.findall(r"## Forces\n.*?```python\n(.*?)```", readme, flags=re.DOTALL)
    names: dict = {}
    exec(model.split("solution =")[0] + forces, names)
    solution = bd.simulate(names["mech"], bd.Ida(rtol=1e-4), t_end=0.3)
    assert solution.status.success
    assert solution.quality.energy_imbalance < 1e-2
