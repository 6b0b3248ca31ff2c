"""`beamdae fit`: options, files, JSON document and exit codes."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed

MODEL = '''
import beamdae as bd


@bd.model(t_end=1.0)
def oscillator(stiffness=30.0, damping=0.5, mass=1.0):
    """A mass on a spring."""
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("mass", mass, at=(1.0, 0.0), velocity=(0.2, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), body.point, stiffness, damping))
    mech.observe("mass", body.point)
    return mech
'''
TIMES = np.linspace(0.1, 1.0, 19)


def displacement(mass):
    """Return the motion without damping: of a mass on a spring of 40 N/m."""
    return 0.2 / (40.0 / mass) ** 0.5 * np.sin((40.0 / mass) ** 0.5 * TIMES)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Working folder with a model, a wide table and a long table of two experiments."""
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(MODEL, encoding="utf-8")
    wide = pd.DataFrame({"t [s]": TIMES, "mass.x [m]": 2.0 * (1.0 + displacement(1.0)) - 0.5})
    wide.to_csv("wide.csv", index=False)
    rows = [
        {"experiment": name, "observable": "mass.x", "time": t, "value": 1.0 + x, "sigma": 1e-3}
        for name, mass in (("light", 1.0), ("heavy", 2.0))
        for t, x in zip(TIMES + 0.01, displacement(mass), strict=True)
    ]
    pd.DataFrame(rows).to_csv("long.csv", index=False)
    return tmp_path


def run(*arguments):
    arguments = ["fit", "model.py", *arguments, "--step", "0.002", "--set", "damping=0"]
    return invoke(*arguments)


@pytest.mark.slow(reason="half a second and more")
def test_files_and_json(here):
    options = ["--scale", "mass.x", "--offset", "mass.x [m]", "--log", "stiffness", "--json"]
    result = run("wide.csv", "--by", "stiffness", *options)
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    # Three parameters are fitted to exact data; the period of the steps is 2e-5 too long.
    estimates = document["estimates"]
    assert estimates["stiffness"]["value"] == pytest.approx(40.0, rel=1e-3)
    assert estimates["scale of mass.x"]["value"] == pytest.approx(2.0, rel=1e-3)
    assert document["model"]["parameters"]["damping"] == 0.0
    names = ["oscillator_fit" + x for x in (".csv", "_residuals.csv", ".html", ".png")]
    assert document["files"] == [str(Path("results", name)) for name in names]
    assert all(Path(name).is_file() for name in document["files"])
    table = pd.read_csv(document["files"][0], index_col="parameter")
    assert table.loc["stiffness", "value"] == estimates["stiffness"]["value"]


@pytest.mark.slow(reason="half a second and more")
def test_experiments_shifts_and_starts(here):
    options = ["--experiment", "heavy:mass=2", "--shift", "light:mass.x", "--no-page"]
    options += ["--shift", "heavy:mass.x=-0.05:0.05", "--bounds", "stiffness=20:80"]
    options += ["--starts", "2", "--jobs", "1", "--max-evaluations", "9", "--no-picture"]
    result = run("long.csv", "--by", "stiffness", *options, "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["estimates"]["stiffness"]["value"] == pytest.approx(40.0, rel=1e-3)
    shift = document["estimates"]["shift of mass.x in heavy"]["value"]
    assert shift == pytest.approx(0.01, rel=1e-2)
    searches = pd.read_csv("results/oscillator_fit_starts.csv")
    assert document["files"][2] == str(Path("results", "oscillator_fit_starts.csv"))
    assert len(document["files"]) == 3
    assert searches["stiffness"].tolist() == pytest.approx([40.0, 40.0], rel=1e-3)
    assert [x["evaluations"] for x in document["searches"]] == searches["evaluations"].tolist()
    # Nothing was printed on the searches. The stored ones are read.
    text = run("long.csv", "--by", "stiffness", *options).stdout
    assert "2 of 2 searches end at this chi-square" in text
    assert len(list(Path("results/oscillator_fit_starts/outcomes").glob("*.json"))) == 2


@pytest.mark.slow(reason="half a second and more")
def test_a_search_that_does_not_converge_ends_with_1(here):
    result = run("wide.csv", "--by", "stiffness", "--max-evaluations", "1", "--no-picture")
    assert result.exit_code == 1
    assert "stopped after 1 evaluation; increase --max-evaluations" in result.stderr
    assert Path("results/oscillator_fit.csv").is_file()


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    "options", [[], ["--bounds", "stiffness=20:80", "--starts", "2", "--jobs", "1"]]
)
def test_regression_warnings_about_data_are_printed_before_the_search(here, options):
    """They were printed after it."""
    table = pd.read_csv("wide.csv").rename(columns={"mass.x [m]": "mass.x"})
    table["mass.x"] *= 1e2
    table.to_csv("cm.csv", index=False)
    options = ["--by", "stiffness", *options, "--max-evaluations", "2", "--no-picture"]
    result = run("cm.csv", *options, "--no-page", "--json")
    document = json.loads(result.stdout)
    first, *others = document["warnings"]
    assert "values of cm.csv without a unit are taken as in the model" in first
    assert not any("without a unit" in x for x in others)
    assert result.stderr.splitlines()[0] == f"warning: {first}"


@pytest.mark.slow(reason="half a second and more")
def test_columns_of_data_may_have_other_names(here):
    table = pd.DataFrame({"Zeit [ms]": 1e3 * TIMES, "Laser [mm]": 1e3 * (1.0 + displacement(1.0))})
    table.to_csv("laser.csv", index=False)
    options = ["--by", "stiffness", "--no-page", "--no-picture", "--json"]
    result = run("laser.csv", *options, "--data-column", "Zeit=t", "--data-column", "Laser=mass.x")
    estimates = json.loads(result.stdout)["estimates"]
    assert estimates["stiffness"]["value"] == pytest.approx(40.0, rel=1e-4)
    result = run("laser.csv", *options, "--data-column", "Zeit=t")
    assert result.exit_code == 2
    assert '--data-column "Laser [mm]=mass.x"' in result.stderr
    arguments = ["run", "model.py", "--data", "laser.csv", "--no-page"]
    mapped = [*arguments, "--data-column", "Zeit [ms]=t", "--data-column", "Laser [mm]=mass.x"]
    shown = succeed(*mapped, "--set", "stiffness=40", "--set", "damping=0")
    assert "mass.x [m]" in shown.output
