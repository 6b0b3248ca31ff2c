"""`beamdae optimize`: files, JSON document, exit codes and messages."""

import json
from pathlib import Path

import pandas as pd
import pytest
from command_line import invoke

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


def run(*arguments):
    return invoke("optimize", "model.py", *arguments)


@pytest.mark.slow(reason="half a second and more")
def test_files_and_json(here):
    limits = ["--at-most", "mass=2", "--bounds", "mass=500g:3kg", "--json"]
    result = run("--by", "mass", "--minimize", "frequency:1:equilibrium", *limits)
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
    result = run("--by", "mass", "--minimize", "frequency:1:equilibrium", *limits)
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
    result = run(*arguments)
    assert result.exit_code == 0, result.output
    assert "e-20" not in result.output
    result = run(*arguments, "--t", "25ms", "--json")
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
    result = run("--by", "mass", "--minimize", "mass", "--bounds", bounds, "--no-page", "--json")
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
    result = run(*by, *bounds, "--starts", "3", "--seed", "1", "--no-page")
    assert result.exit_code == 0, result.output
    assert "3 of 3 searches end at this objective" in " ".join(result.stdout.split())
    table = pd.read_csv("results/oscillator_design_starts.csv")
    assert list(table["first mass"].between(0.5, 3.0)) == [True] * 3
    result = run(*by, *bounds, "--starts", "3", "--seed", "1", "--no-page", "--json")
    searches = json.loads(result.stdout)["searches"]
    assert [x["first mass"] for x in searches] == pytest.approx(list(table["first mass"]))
    result = run(*by, "--starts", "3")
    assert result.exit_code == 2
    assert "pass those of mass, stiffness in --bounds NAME=LOW:HIGH" in result.stderr


@pytest.mark.slow(reason="half a second")
def test_regression_searches_without_a_feasible_design_state_value_and_limit(here):
    """They stated a relative violation only, and the advice named an argument of Python."""
    options = ["--at-most", "frequency:1:equilibrium=0.1 Hz", "--bounds", "mass=500g:3kg"]
    result = run("--by", "mass", "--minimize", "mass", *options, "--no-page")
    assert result.exit_code == 1
    error = " ".join(result.stderr.split())
    # f = sqrt(k/m) / (2 pi)
    assert ("in the best one frequency 1 is 0.5812 Hz, but the limit is at most 0.1 Hz;") in error
    assert "start it from other values (--set NAME=VALUE)" in error
    result = run("--by", "mass", "--minimize", "mass", "--bounds", "mass=2kg:3kg")
    assert "or pass another first value, --set NAME=VALUE" in " ".join(result.stderr.split())
