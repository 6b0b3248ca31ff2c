"""Estimates of the error of a run against the truth, and verification by another method."""

from dataclasses import replace

import numpy as np
import pytest
from hub_beam import hub_beam

import beamdae as bd
from beamdae.verification import ERROR, exceeded


@pytest.fixture(scope="module")
def truth():
    return bd.simulate(hub_beam(elements=4), bd.Radau(1e-8), t_end=0.5, output_step=5e-3)


@pytest.mark.parametrize(
    "integrator",
    [bd.Auto(1e-4), bd.Radau(1e-3), bd.GeneralizedAlpha(rtol=1e-4), bd.GeneralizedAlpha(2e-3)],
    ids=lambda one: one.label,
)
def test_the_estimate_covers_the_error_and_is_of_its_size(integrator, truth):
    solution = bd.simulate(hub_beam(elements=4), integrator, t_end=0.5, output_step=5e-3)
    columns = ["tip.x [m]", "tip.y [m]", "tip.angle [rad]", "hub.angle [rad]"]
    known = truth.observed[columns].to_numpy()
    off = np.abs(solution.observed[columns].to_numpy() - known).max(axis=0)
    true = off / (0.5 * np.ptp(known, axis=0))
    told = bd.error_estimate(solution).loc[columns, ERROR].to_numpy()
    assert np.all(told > true)
    # The median over the cases of validation/tolerances is below 5.
    assert np.all(told < 50.0 * true)


def test_columns_at_rest_have_no_error(truth):
    told = bd.error_estimate(replace(truth, made_by=bd.Radau(1e-3)))
    assert told.loc["hub.x [m]", ERROR] == 0.0
    assert told.loc["tip.x [m]", ERROR] > 0.0


def test_another_method_agrees_and_one_that_is_wrong_differs(truth):
    right = bd.verify(replace(truth, made_by=bd.Ida(1e-4)))
    assert right.loc["tip.y [m]", "verdict"] == "agrees"
    assert right.loc["root force.M [N m]", "verdict"].startswith("known to ")
    # The same run, said to be that of a heavier hub's equations.
    other = bd.equations_of_motion(hub_beam(elements=4, torque=11.0))
    wrong = bd.verify(replace(truth, equations=other, made_by=bd.Ida(1e-4)))
    assert wrong.loc["tip.y [m]", "verdict"] == "differs"


def test_what_could_not_be_run_again_is_unknown_and_not_verified():
    solution = bd.simulate(hub_beam, bd.Ida(1e-4, max_steps=5), t_end=0.5)
    assert not solution.status.success
    # As far as it went, the coarser run ends; one without a single step has nothing to compare.
    short = replace(solution, t=solution.t[:1])
    assert bd.error_estimate(short)[ERROR].isna().all()
    assert set(bd.verify(short)["verdict"]) == {"not verified"}


def test_a_solution_that_does_not_know_its_integrator_is_refused(truth):
    with pytest.raises(bd.BeamdaeError, match="made_by must be the integrator of the run"):
        bd.error_estimate(replace(truth, made_by=None))


def test_a_run_that_is_off_by_more_than_is_promised_says_so(truth):
    errors = bd.error_estimate(replace(truth, made_by=bd.Radau(1e-3)))
    solution = replace(truth, made_by=bd.Ida(1e-4))
    errors[ERROR] = 0.5e-2
    assert exceeded(solution, errors) == ""
    errors.loc["root force.M [N m]", ERROR] = 1.0
    assert exceeded(solution, errors) == ""
    errors.loc["tip.y [m]", ERROR] = 0.02
    assert exceeded(solution, errors).startswith("tip.y [m]: its error is put at 0.02 of half")
    fixed = replace(truth, made_by=bd.GeneralizedAlpha(1e-3))
    assert exceeded(fixed, errors) == ""
