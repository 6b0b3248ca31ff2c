"""Errors of fits, compared with fits of exact beams."""

import re

import numpy as np
import pandas as pd
import pytest
from mechanisms import clamped_beam, mass_on_rail, rectangle

import beamdae as bd


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
