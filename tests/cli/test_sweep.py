"""`beamdae sweep`: values on the command line, usage errors, and files."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed
from model_texts import CROSS
from model_texts import SWING as MODEL
from numpy.testing import assert_allclose

VALUES = """
import beamdae as bd


@bd.model(t_end=1e-3)
def mass(speed=1.0, turns=1, color="red", at=(0.0, 0.0), length=bd.param(1.0, "m", "length")):
    mech = bd.Mechanism()
    mech.observe("mass", mech.add(bd.PointMass("mass", 1.0, at=(0.0, 0.0))).point)
    return mech
"""


@pytest.mark.slow(reason="ten sweeps")
@pytest.mark.parametrize(
    ("over", "read"),
    [
        ("speed=1,2.5", ["1.0", "2.5"]),
        ("speed=0.1:0.5:5", ["0.1", "0.2", "0.3", "0.4", "0.5"]),
        ("speed=1e-3:10:5:log", ["0.001", "0.01", "0.1", "1.0", "10.0"]),
        ("speed=3:3:1", ["3.0"]),
        ("turns=4:16:4", ["4", "8", "12", "16"]),
        ("color=red, a:b", ["red", "a:b"]),
        ("at=(1, 0), (2.0, 3)", ["(1.0, 0.0)", "(2.0, 3.0)"]),
        ("length=50cm:1 m:3", ["0.5", "0.75", "1.0"]),
        ("length=1mm:0.1 m:3:log", ["0.001", "0.01", "0.1"]),
        ("length=850mm,0.9", ["0.85", "0.9"]),
    ],
)
def test_values_of_over(over, read, tmp_path):
    path = tmp_path / "values.py"
    path.write_text(VALUES)
    options = ("--over", over, "--jobs", "1", "--out", tmp_path, "--no-page", "--no-picture")
    succeed("sweep", path, *options)
    (file,) = tmp_path.rglob("sweep.csv")
    assert list(pd.read_csv(file, dtype=str).iloc[:, 0]) == read


SWEEP = """

@bd.sweep(swing, of="bob.y", integrator=bd.GeneralizedAlpha(step=5e-3))
def speeds():
    return {"speed": [1.0, 9.0]}
"""


@pytest.mark.slow(reason="starts worker processes")
def test_sweep_writes_a_table_plots_and_a_page(tmp_path):
    path = tmp_path / "model.py"
    path.write_text(MODEL)
    arguments = ["sweep", str(path), "--over", "speed=1:9:3", "--over", "turns=1,2", "--jobs", "1"]
    arguments += ["--of", "bob.x", "--integrator", "generalized-alpha", "--step", "5e-3"]
    result = succeed(*arguments, "--out", str(tmp_path))
    assert "6 cases, 4 reached the end time" in result.output
    assert "too fast" in result.output
    folder = tmp_path / "swing_sweep_speed_turns"
    files = {file.name for file in folder.glob("[!.]*") if file.is_file()}
    assert files == {"cases.csv", "sweep.csv", "report.html", "response.png", "map.png"}
    table = pd.read_csv(folder / "sweep.csv")
    assert list(table["speed"]) == [1.0, 1.0, 5.0, 5.0, 9.0, 9.0]
    assert_allclose(table["bob.x min [m]"][:4], np.cos([0.1, 0.1, 0.5, 0.5]), atol=1e-6)


@pytest.mark.slow(reason="runs two sweeps")
def test_regression_sweeps_name_the_columns_that_the_terminal_omits(tmp_path):
    """The table contained the first observable only."""
    path = tmp_path / "model.py"
    more = 'mech.observe("hub", bob.at(0.0, 0.0))\n    mech.observe("end", bob.at(2.0, 0.0))\n'
    path.write_text(MODEL.replace("    if speed >", f"    {more}    if speed >"))
    arguments = ["sweep", str(path), "--over", "speed=1,2", "--jobs", "1", "--no-picture"]
    arguments += ["--integrator", "generalized-alpha", "--step", "5e-3", "--out", str(tmp_path)]
    outputs = {}
    for of in ((), ("--of", "end.y")):
        result = invoke(*arguments, "--no-page", *of, env={"COLUMNS": "400"})
        outputs[of] = " ".join(result.stdout.split())
    every, one = outputs.values()
    for name in ("bob.y", "hub.angle"):
        assert name in every
    assert "max [m]" in one


@pytest.mark.slow(reason="starts worker processes")
def test_sweep_of_a_file_runs_and_resumes(tmp_path):
    path = tmp_path / "sweep.py"
    path.write_text(MODEL + SWEEP)
    arguments = ["sweep", str(path), "--jobs", "1", "--out", str(tmp_path)]
    succeed(*arguments)
    table = pd.read_csv(tmp_path / "speeds" / "sweep.csv")
    assert list(table["status"]) == ["ok", "failed"]
    again = invoke(*arguments, "--of", "bob.x")
    assert "2 stored before" in again.output
    assert again.exit_code == 0
    assert "bob.x max [m]" in pd.read_csv(tmp_path / "speeds" / "sweep.csv")
    document = json.loads(invoke(*arguments, "--json").stdout)
    assert [case["status"] for case in document["cases"]] == ["ok", "failed"]
    compared = invoke("compare", str(path))
    assert "speeds is a sweep; use beamdae sweep." in compared.output


@pytest.mark.slow(reason="starts worker processes")
@pytest.mark.parametrize("command", ["sweep", "compare"])
def test_studies_start_from_a_state(command, tmp_path):
    path = tmp_path / "model.py"
    path.write_text(MODEL)
    over = ["--over", "speed=1,2"] if command == "sweep" else []
    arguments = [command, str(path), *over, "--jobs", "1", "--no-picture", "--no-page"]
    arguments += ["--start", "bob.angle=90deg", "--out", str(tmp_path)]
    succeed(*arguments)
    rows = pd.read_csv(next(tmp_path.rglob("trajectories/*.csv")))
    assert rows["bob.y [m]"][0] == pytest.approx(1.0)


@pytest.mark.slow(reason="a sweep of 28 cases")
def test_long_sweeps_print_their_first_cases(tmp_path):
    """They printed no value."""
    path = tmp_path / "model.py"
    path.write_text(MODEL)
    arguments = ["--over", "speed=0.5:1.5:28", "--of", "bob.x,bob.y", "--t-end", "0.01"]
    arguments += ["--jobs", "1", "--no-page", "--no-picture", "--out", str(tmp_path)]
    result = succeed("sweep", path, *arguments, env={"COLUMNS": "80"})
    assert "not shown: 4 rows; see sweep.csv" in result.stdout
    assert len(re.findall(r"^ [01]\.\d", result.stdout, re.MULTILINE)) == 24
    assert re.search(r"bob\.[xy] +bob\.[yx] ", result.stdout)
    (file,) = tmp_path.rglob("sweep.csv")
    assert "reason" not in pd.read_csv(file)


@pytest.mark.slow(reason="starts worker processes")
def test_modes_of_a_sweep_are_about_a_state(tmp_path):
    path = tmp_path / "cross.py"
    path.write_text(CROSS)
    arguments = ["sweep", path, "--over", "stiffness=32,50", "--set", "weight=9.81"]
    arguments += ["--jobs", "1", "--no-page", "--no-picture", "--out", tmp_path, "--modes", "1"]
    assert "use --about equilibrium" in " ".join(invoke(*arguments).output.split())
    result = succeed(*arguments, "--about", "equilibrium")
    assert "warning" not in result.output
    (file,) = tmp_path.rglob("sweep.csv")
    assert_allclose(pd.read_csv(file)["frequency 1 [Hz]"], [0.63662, 0.79577], rtol=1e-3)
    result = invoke("sweep", path, "--over", "stiffness=1,2", "--about", "equilibrium")
    assert "--about requires --modes" in result.stderr
