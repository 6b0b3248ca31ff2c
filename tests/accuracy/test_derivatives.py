"""Errors of derivatives, designs and fits."""

import pickle
import re

import numpy as np
import pandas as pd
import pytest
from mechanisms import STEEL, cantilever, clamped_beam, mass_on_rail, rectangle

import beamdae as bd
from beamdae import quantities

FINE = {"elements": 4, "strain": "exact"}


@bd.model(t_end=0.3)
def bent_strip(load=0.02, height=2e-3, elements=1, strain="nonlinear"):
    """Return a clamped strip that a force bends far."""
    section = rectangle(height, 0.01, damping=5e-3)
    mech, beam = clamped_beam(section, elements, strain=strain)
    size = load * STEEL.E * 0.01 * 8e-9
    mech.add(bd.Force("load", beam.end, (0.0, bd.sine(size, 0.8))))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.slow(reason="several runs with sensitivities")
@pytest.mark.parametrize(
    ("method", "cause"),
    [(bd.Radau(1e-5), "mesh"), (bd.GeneralizedAlpha(step=0.01), "time")],
)
def test_errors_of_sensitivities_contain_those_of_mesh_and_steps(method, cause):
    values = FINE if cause == "time" else {}
    coarse = bd.sensitivities(bent_strip, "load", method, parameters=values, estimate_error=False)
    fine = bd.sensitivities(
        bent_strip, "load", bd.Radau(1e-7), parameters=FINE, estimate_error=False
    )
    expected = fine.sensitivity("tip.y", "load")
    error = np.linalg.norm(coarse.sensitivity("tip.y", "load") - expected)
    error /= np.linalg.norm(expected)
    row = coarse.errors.table().loc["d(tip.y)/d(load) [m per unit of load]"]
    assert 0.5 * error < row["total"] < 2.0 * error
    assert row[cause] > 0.5 * row["total"]


@pytest.mark.slow(reason="several runs with gradients")
def test_errors_of_gradients_contain_those_of_the_mesh():
    objective, method = bd.quantities.EndValue("tip.y"), bd.Radau(1e-6)
    names = ["load", "height"]
    coarse = bd.gradient(bent_strip, objective, names, method, estimate_error=False)
    fine = bd.gradient(bent_strip, objective, names, method, parameters=FINE, estimate_error=False)
    sizes = np.array([0.02, 2e-3])
    errors = sizes * np.abs(coarse.array - fine.array) / np.max(sizes * np.abs(fine.array))
    np.testing.assert_allclose(coarse.errors.total[1:], errors, rtol=1.0, atol=1e-3)
    assert coarse.errors.headers[1:] == (
        "d(objective)/d(load) [per unit of load]",
        "d(objective)/d(height) [per unit of height]",
    )


def test_known_errors_are_kept_by_pickle():
    result = bd.sensitivities(bent_strip, "load", bd.GeneralizedAlpha(step=0.01), 0.05)
    known = result.errors.total
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(result)).errors.total, known)


def test_derivatives_from_another_process_are_not_checked():
    method = bd.GeneralizedAlpha(step=0.01)
    result = bd.sensitivities(bent_strip, "load", method, 0.05, estimate_error=False)
    again = pickle.loads(pickle.dumps(result))
    assert again.errors.reason == "the derivatives come from another process"


WIDTH = 0.01


@bd.model(t_end=1.0)
def bent_cantilever(height=2e-3, elements=1, strain="nonlinear"):
    """Return a clamped strip that a force bends far."""
    section = rectangle(height, WIDTH, damping=1e-3)
    return cantilever(elements, 1.0, section, (0.0, -0.1 * STEEL.E * WIDTH * 8e-9), strain=strain)


def optimize(limit, **parameters):
    bounds = {"height": (1e-3, 4e-3)}
    return bd.optimize(
        bent_cantilever, quantities.Mass(), "height", limit, bounds, parameters=parameters
    )


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("limit", [0.5, 0.52])
def test_errors_of_limited_values_are_true(limit):
    with pytest.warns(bd.BeamdaeWarning, match=r"tip.x.*: the error is about .* of its value"):
        design = optimize(quantities.at_least(quantities.EquilibriumValue("tip.x"), limit))
    finer = bd.equilibrium(bent_cantilever(**design.parameters, elements=4, strain="exact"))
    error = abs(finer["tip.x"].iloc[-1] / limit - 1.0)
    table = design.errors.table()
    row = table.iloc[1]
    assert error > 0.04
    assert 0.5 * error < row["total"] < 2.0 * error
    assert row["value"] == pytest.approx(limit, rel=1e-5)
    # The mass does not depend on the elements.
    assert table["total"].iloc[0] == pytest.approx(0.0, abs=1e-9)
    assert next(design.errors.sentences()) in design.warnings


@pytest.mark.slow(reason="half a second")
def test_accurate_designs_have_no_sentence():
    limit = quantities.at_least(quantities.EquilibriumValue("tip.y"), -0.5)
    design = optimize(limit, elements=4, strain="exact")
    assert design.errors.largest < 0.01
    assert design.warnings == ()


def test_designs_without_analyses_are_not_checked():
    size = quantities.ParameterFunction(lambda height: height, "height")
    design = bd.optimize(bent_cantilever, size, "height", [], {"height": (1e-3, 4e-3)})
    assert design.errors.reason == "no quantity depends on steps or beams"


@bd.model(t_end=1.0)
def released_strip(E=67.0e9, damping=8e-4, strain="green", elements=4):
    """A strip of aluminum with a heavy end that gravity pulls down from its drawing."""
    alloy = bd.Material(E=E, nu=0.3, rho=2700.0)
    section = rectangle(0.002, 0.025, damping=damping, material=alloy)
    mech, strip = clamped_beam(section, elements, 0.45, name="strip", gravity=9.81, strain=strain)
    mech.add(bd.PointMass("mass", 0.2, on=strip.end))
    mech.observe("tip", strip.end)
    return mech


def measured(scale=1e-3):
    """Return data of a strip of exact beams with noise."""
    run = bd.simulate(released_strip(strain="exact", elements=8), bd.Radau(1e-8), 1.0, 5e-3)
    noise = np.random.default_rng(1).normal(scale=scale, size=len(run.t))
    return pd.DataFrame({"t [s]": run.t, "tip.y [m]": run["tip.y"].to_numpy() + noise})


@pytest.mark.slow(reason="fits of a beam")
def test_errors_of_estimates_are_true():
    """The errors of moderate strains are six standard deviations of the modulus, but only 0.5 %."""
    data, names = measured(), ["E", "damping"]
    fits = {
        strain: bd.fit(released_strip, data, names, sigma=1e-3, parameters={"strain": strain})
        for strain in ("green", "exact")
    }
    warned = {
        strain: "".join(x for x in fit.warnings if "would" in x) for strain, fit in fits.items()
    }
    assert warned["exact"] == ""
    found = re.search(r"estimates would change by up to (\S+) standard", warned["green"])
    assert found is not None
    green, exact = (np.array(list(x.parameters.values())) for x in fits.values())
    change = exact - green
    expected = np.sqrt(change @ np.linalg.solve(fits["green"].covariance, change))
    # The first step of a search that begins at the estimates.
    assert float(found[1]) == pytest.approx(expected, rel=0.1)
    assert 'use strain="exact" of strip' in warned["green"]
    table = fits["green"].errors.table()
    assert list(table.index) == ["E [-]", "damping [-]", "tip.y [m]"]
    np.testing.assert_allclose(table["companion"].iloc[:2], exact, rtol=3e-3)
    assert table.loc["E [-]", "theory"] > 0.9 * table.loc["E [-]", "total"]


@bd.model(t_end=3.0)
def oscillator(stiffness=30.0):
    mech, mass = mass_on_rail(x=1.0, velocity=(0.2, 0.0), spring=(stiffness, 0.2))
    mech.observe("mass", mass.point)
    return mech


@pytest.mark.parametrize("stiffness", [30.0, 10.0])
def test_errors_of_steps_are_true(stiffness):
    run = bd.simulate(oscillator(stiffness=stiffness), bd.Radau(1e-9), 3.0, 0.02)
    noise = np.random.default_rng(2).normal(scale=1e-3, size=len(run.t))
    data = pd.DataFrame({"t [s]": run.t, "mass.x [m]": run["mass.x"].to_numpy() + noise})
    coarse, accurate = (
        bd.fit(oscillator, data, "stiffness", x, sigma=1e-3)
        for x in (bd.GeneralizedAlpha(step=0.1), bd.Radau(1e-6))
    )
    (sentence,) = (x for x in coarse.warnings if "would change" in x)
    assert re.search(r"short steps of Radau; use step=\S+\.$", sentence)
    assert not any("would change" in x for x in accurate.warnings)
    assert accurate.errors.largest < 1e-4
    row = coarse.errors.table().loc["stiffness [-]"]
    error = coarse.parameters["stiffness"] / accurate.parameters["stiffness"] - 1.0
    assert 0.5 * abs(error) < row["total"] < 2.0 * abs(error)
    assert row["time"] == row["total"]
