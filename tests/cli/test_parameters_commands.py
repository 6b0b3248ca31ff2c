"""`beamdae fit` and `beamdae optimize`: files, options and messages."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed

FIT_MODEL = '''
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
def folder(tmp_path, monkeypatch):
    """Working folder with a model, a wide table and a long table of two experiments."""
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(FIT_MODEL, encoding="utf-8")
    wide = pd.DataFrame({"t [s]": TIMES, "mass.x [m]": 2.0 * (1.0 + displacement(1.0)) - 0.5})
    wide.to_csv("wide.csv", index=False)
    rows = [
        {"experiment": name, "observable": "mass.x", "time": t, "value": 1.0 + x, "sigma": 1e-3}
        for name, mass in (("light", 1.0), ("heavy", 2.0))
        for t, x in zip(TIMES + 0.01, displacement(mass), strict=True)
    ]
    pd.DataFrame(rows).to_csv("long.csv", index=False)
    return tmp_path


def fit(*arguments):
    arguments = ["fit", "model.py", *arguments, "--step", "0.002", "--set", "damping=0"]
    return invoke(*arguments)


@pytest.mark.slow(reason="half a second and more")
def test_files_and_json_of_a_fit(folder):
    options = ["--scale", "mass.x", "--offset", "mass.x [m]", "--log", "stiffness", "--json"]
    result = fit("wide.csv", "--by", "stiffness", *options)
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
def test_experiments_shifts_and_starts(folder):
    options = ["--experiment", "heavy:mass=2", "--shift", "light:mass.x", "--no-page"]
    options += ["--shift", "heavy:mass.x=-0.05:0.05", "--bounds", "stiffness=20:80"]
    options += ["--starts", "2", "--jobs", "1", "--max-evaluations", "9", "--no-picture"]
    result = fit("long.csv", "--by", "stiffness", *options, "--json")
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
    text = fit("long.csv", "--by", "stiffness", *options).stdout
    assert "2 of 2 searches end at this chi-square" in text
    assert len(list(Path("results/oscillator_fit_starts/outcomes").glob("*.json"))) == 2


@pytest.mark.slow(reason="half a second and more")
def test_a_search_that_does_not_converge_ends_with_1(folder):
    result = fit("wide.csv", "--by", "stiffness", "--max-evaluations", "1", "--no-picture")
    assert result.exit_code == 1
    assert "stopped after 1 evaluation; increase --max-evaluations" in result.stderr
    assert Path("results/oscillator_fit.csv").is_file()


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    "options", [[], ["--bounds", "stiffness=20:80", "--starts", "2", "--jobs", "1"]]
)
def test_regression_warnings_about_data_are_printed_before_the_search(folder, options):
    """They were printed after it."""
    table = pd.read_csv("wide.csv").rename(columns={"mass.x [m]": "mass.x"})
    table["mass.x"] *= 1e2
    table.to_csv("cm.csv", index=False)
    options = ["--by", "stiffness", *options, "--max-evaluations", "2", "--no-picture"]
    result = fit("cm.csv", *options, "--no-page", "--json")
    document = json.loads(result.stdout)
    first, *others = document["warnings"]
    assert "values of cm.csv without a unit are taken as in the model" in first
    assert not any("without a unit" in x for x in others)
    assert result.stderr.splitlines()[0] == f"warning: {first}"


@pytest.mark.slow(reason="half a second and more")
def test_columns_of_data_may_have_other_names(folder):
    table = pd.DataFrame({"Zeit [ms]": 1e3 * TIMES, "Laser [mm]": 1e3 * (1.0 + displacement(1.0))})
    table.to_csv("laser.csv", index=False)
    options = ["--by", "stiffness", "--no-page", "--no-picture", "--json"]
    result = fit("laser.csv", *options, "--data-column", "Zeit=t", "--data-column", "Laser=mass.x")
    estimates = json.loads(result.stdout)["estimates"]
    assert estimates["stiffness"]["value"] == pytest.approx(40.0, rel=1e-4)
    result = fit("laser.csv", *options, "--data-column", "Zeit=t")
    assert result.exit_code == 2
    assert '--data-column "Laser [mm]=mass.x"' in result.stderr
    arguments = ["run", "model.py", "--data", "laser.csv", "--no-page"]
    mapped = [*arguments, "--data-column", "Zeit [ms]=t", "--data-column", "Laser [mm]=mass.x"]
    shown = succeed(*mapped, "--set", "stiffness=40", "--set", "damping=0")
    assert "mass.x [m]" in shown.output


MODEL = '''
import beamdae as bd


@bd.model(t_end=0.1)
def oscillator(stiffness=40.0, mass=bd.param(1.0, "kg", "mass on the spring")):
    """A mass on a spring along a rail."""
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("mass", mass, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), body.point))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), body.point, stiffness))
    mech.observe("mass", body.point)
    return mech
'''


def optimize(*arguments):
    return invoke("optimize", "model.py", *arguments)


@pytest.mark.slow(reason="half a second and more")
def test_files_and_json_of_an_optimization(here):
    limits = ["--at-most", "mass=2", "--bounds", "mass=500g:3kg", "--json"]
    result = optimize("--by", "mass", "--minimize", "frequency:1:equilibrium", *limits)
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["parameters"]["mass"] == pytest.approx(2.0)
    # f = sqrt(k/m) / (2 pi)
    assert document["objective"] == pytest.approx(20.0**0.5 / 6.283185307, rel=1e-6)
    assert document["constraints"][0]["multiplier"] > 0.0
    table = pd.read_csv("results/oscillator_design.csv", index_col="parameter")
    assert table.loc["mass", "value"] == pytest.approx(2.0)
    assert list(table.loc["mass", ["lower bound", "upper bound"]]) == [0.5, 3.0]
    designs = pd.read_csv("results/oscillator_designs.csv")
    assert len(designs) == document["evaluations"]


@pytest.mark.slow(reason="one second")
def test_regression_results_have_units_and_relative_margins(here):
    """The objective had no unit, and limits that were reached had margins such as -12.4."""
    limits = ["--at-most", "mass=2000 g", "--at-least", "mass=1 kg", "--bounds", "mass=500g:3kg"]
    result = optimize("--by", "mass", "--minimize", "frequency:1:equilibrium", *limits)
    assert result.exit_code == 0, result.output
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    assert "objective frequency 1 = 0.711763 Hz, first 1.00658 Hz" in lines
    assert "mass >= 1 kg 2 1 100 0" in lines
    assert "mass [kg] 2 1 0.5 3 no" in lines
    assert any(line.startswith("mass <= 2 kg 2 2 0 0.1779") for line in lines), lines


LEAF = """
import beamdae as bd


@bd.model(t_end=0.1)
def leaf(height=bd.param(1e-3, "m")):
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.01, height=height)
    beam = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.1, 0.0)), section, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    law = bd.sine(1e-3, frequency=10.0)
    target = mech.ground.at(0.1, 0.0)
    mech.add(bd.TranslationalDriver("drive", target, beam.end, law, direction=(0, 1)))
    mech.observe("stress", beam.largest_stress(exponent=150))
    return mech
"""


@pytest.mark.slow(reason="two seconds")
def test_regression_equilibria_are_at_a_time(here):
    """At t = 0, where the driver is at zero, the search ended at a bound, the stress at 1e-202."""
    Path("model.py").write_text(LEAF, encoding="utf-8")
    arguments = ["--by", "height", "--maximize", "height", "--bounds", "height=0.5mm:5mm"]
    arguments += ["--at-most", "equilibrium:stress.bound=100 MPa", "--no-page"]
    result = optimize(*arguments)
    assert result.exit_code == 0, result.output
    assert "e-20" not in result.output
    result = optimize(*arguments, "--t", "25ms", "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    # Cantilever with the deflection d at its end: stress = 3 E h d / (2 L^2) at the clamp.
    height = 1e8 * 2.0 * 0.1**2 / (3.0 * 2.1e11 * 1e-3)
    assert document["parameters"]["height"] == pytest.approx(height, rel=0.01)
    assert not document.get("warnings")
    # The bound is reached; the largest stress, below it, is beside it.
    observed = document["observed"]
    assert list(observed) == ["stress.largest [Pa]", "stress.bound [Pa]"]
    ends = [x["end"] for x in observed.values()]
    assert 0.95 * 1e8 < ends[0] < ends[1] == pytest.approx(1e8, rel=1e-4)


@pytest.mark.parametrize(
    ("bounds", "expected"),
    [("mass=500g:", 0.5), ("mass=500g:inf", 0.5), ("mass=:3kg", None)],
)
def test_regression_bounds_may_have_one_end(here, bounds, expected):
    result = optimize(
        "--by", "mass", "--minimize", "mass", "--bounds", bounds, "--no-page", "--json"
    )
    if expected is None:
        # Without a lower bound, masses become negative.
        assert (result.exit_code, "pass --bounds that exclude such designs" in result.stderr) == (
            1,
            True,
        )
    else:
        # The search has scaled variables.
        mass = json.loads(result.stdout)["parameters"]["mass"]
        assert mass == pytest.approx(expected, rel=1e-14)


@pytest.mark.slow(reason="a second")
def test_several_starts_have_a_table(here):
    by = ["--by", "mass,stiffness", "--minimize", "mass", "--at-least", "stiffness=30"]
    bounds = ["--bounds", "mass=500g:3kg", "--bounds", "stiffness=20:50"]
    result = optimize(*by, *bounds, "--starts", "3", "--seed", "1", "--no-page")
    assert result.exit_code == 0, result.output
    assert "3 of 3 searches end at this objective" in " ".join(result.stdout.split())
    table = pd.read_csv("results/oscillator_design_starts.csv")
    assert list(table["first mass"].between(0.5, 3.0)) == [True] * 3
    result = optimize(*by, *bounds, "--starts", "3", "--seed", "1", "--no-page", "--json")
    searches = json.loads(result.stdout)["searches"]
    assert [x["first mass"] for x in searches] == pytest.approx(list(table["first mass"]))
    result = optimize(*by, "--starts", "3")
    assert result.exit_code == 2
    assert "pass those of mass, stiffness in --bounds NAME=LOW:HIGH" in result.stderr


@pytest.mark.slow(reason="half a second")
def test_regression_searches_without_a_feasible_design_state_value_and_limit(here):
    """They stated a relative violation only, and the advice named an argument of Python."""
    options = ["--at-most", "frequency:1:equilibrium=0.1 Hz", "--bounds", "mass=500g:3kg"]
    result = optimize("--by", "mass", "--minimize", "mass", *options, "--no-page")
    assert result.exit_code == 1
    error = " ".join(result.stderr.split())
    # f = sqrt(k/m) / (2 pi)
    assert ("in the best one frequency 1 is 0.5812 Hz, but the limit is at most 0.1 Hz;") in error
    assert "start it from other values (--set NAME=VALUE)" in error
    result = optimize("--by", "mass", "--minimize", "mass", "--bounds", "mass=2kg:3kg")
    assert "or pass another first value, --set NAME=VALUE" in " ".join(result.stderr.split())
