"""Estimates of the error of a run against the truth, and verification by another method."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hub_beam import hub_beam

import beamdae as bd
from beamdae.integrators.integrator import Accuracy
from beamdae.verification import RELATIVE_ERROR, accuracy_warning


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
    told = bd.error_estimate(solution).loc[columns, RELATIVE_ERROR].to_numpy()
    assert np.all(told > true)
    # The median over the cases of validation/tolerances is below 5.
    assert np.all(told < 50.0 * true)


def test_columns_at_rest_have_no_error(truth):
    told = bd.error_estimate(replace(truth, made_by=bd.Radau(1e-3)))
    assert told.loc["hub.x [m]", RELATIVE_ERROR] == 0.0
    assert told.loc["tip.x [m]", RELATIVE_ERROR] > 0.0


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
    assert bd.error_estimate(short)[RELATIVE_ERROR].isna().all()
    assert set(bd.verify(short)["verdict"]) == {"not verified"}


def test_a_solution_that_does_not_know_its_integrator_is_refused(truth):
    with pytest.raises(bd.BeamdaeError, match="made_by of the solution must be"):
        bd.error_estimate(replace(truth, made_by=None))


def test_a_run_that_is_off_by_more_than_is_promised_says_so(truth):
    errors = bd.error_estimate(replace(truth, made_by=bd.Radau(1e-3)))
    solution = replace(truth, made_by=bd.Ida(1e-4))
    errors[RELATIVE_ERROR] = 0.5e-2
    assert accuracy_warning(solution, errors) == ""
    errors.loc["root force.M [N m]", RELATIVE_ERROR] = 1.0
    assert accuracy_warning(solution, errors) == ""
    errors.loc["tip.y [m]", RELATIVE_ERROR] = 0.02
    assert accuracy_warning(solution, errors).startswith(
        "tip.y [m]: the estimated error is 0.02 of half"
    )
    fixed = replace(truth, made_by=bd.GeneralizedAlpha(1e-3))
    assert accuracy_warning(fixed, errors) == ""


def _oscillator(q0=1.0, center=0.0, **kwargs):
    t, q, v = ca.SX.sym("t"), ca.SX.sym("q"), ca.SX.sym("v")
    observe = {name: given(q) for name, given in kwargs.items()}
    return bd.ConstrainedSystem(
        t=t, q=q, v=v, mass=[1.0], force=center - q, q0=[q0], v0=[0.0], observe=observe
    )


def test_the_loosest_tolerance_there_is_has_an_estimate():
    # There is none ten times as loose to compare with.
    solution = bd.simulate(_oscillator(), bd.Ida(0.1), t_end=10.0)
    known = np.cos(solution.t)
    true = np.abs(solution.q[:, 0] - known).max() / (0.5 * np.ptp(known))
    assert bd.error_estimate(solution)[RELATIVE_ERROR].iloc[0] > true


def test_a_run_of_the_same_steps_tells_nothing():
    # Both runs have one step: their difference is 0, the error of the motion more than all of it.
    solution = bd.simulate(_oscillator(), bd.GeneralizedAlpha(3.0), t_end=3.0)
    assert bd.error_estimate(solution)[RELATIVE_ERROR].isna().all()


def test_steps_that_the_length_of_the_run_limits_tell_nothing():
    # 58 and 59 steps: their difference is a fortieth of the error.
    solution = bd.simulate(_oscillator(), bd.GeneralizedAlpha(rtol=0.01), t_end=1.0)
    assert bd.error_estimate(solution)[RELATIVE_ERROR].isna().all()


def test_columns_that_are_not_finite_have_no_error_told():
    system = _oscillator(root=ca.sqrt, inverse=lambda q: 1.0 / (q - q))
    told = bd.error_estimate(bd.simulate(system, bd.Ida(1e-3), t_end=10.0))
    assert told.loc[["root [-]", "inverse [-]"]].isna().all(axis=None)
    assert told.loc["q0 [-]", RELATIVE_ERROR] > 0.0


def test_columns_without_a_unit_are_not_at_rest_beside_each_other():
    system = _oscillator(large=lambda q: 1e12 * q)
    told = bd.error_estimate(bd.simulate(system, bd.Ida(1e-3), t_end=10.0))[RELATIVE_ERROR]
    assert told["q0 [-]"] == pytest.approx(told["large [-]"])
    assert told["q0 [-]"] > 0.0


def test_what_rounding_moves_is_at_rest():
    # Three in equilibrium: rounding takes it to and fro by some 1e-15.
    solution = bd.simulate(_oscillator(q0=3.0, center=3.0 + 1e-14), bd.Ida(), t_end=10.0)
    assert bd.error_estimate(solution)[RELATIVE_ERROR].iloc[0] == 0.0


def test_a_verification_promises_no_more_than_the_looser_run():
    solution = bd.simulate(hub_beam(elements=2), bd.Radau(1e-6), t_end=0.05)
    assert bd.verify(solution, bd.Ida(1e-4))["allowed"].max() == pytest.approx(1e-2)


def test_an_integrator_without_a_field_to_refine_by_is_refused(truth):
    class Odd(bd.Ida):
        @property
        def accuracy(self):
            return Accuracy("tolerance", 1e-5)

    with pytest.raises(bd.BeamdaeError, match="the accuracy of Odd must be its field"):
        bd.error_estimate(replace(truth, made_by=Odd()))


def test_the_estimate_covers_the_error_of_a_method_of_first_order():
    # The difference to twice the step is the error itself there, less a little.
    solution = bd.simulate(
        _oscillator(), bd.GeneralizedAlpha(0.01, family="newmark", rho_inf=0.5), t_end=5.0
    )
    known = np.cos(solution.t)
    true = np.abs(solution.q[:, 0] - known).max() / (0.5 * np.ptp(known))
    assert true < bd.error_estimate(solution)[RELATIVE_ERROR].iloc[0] < 5.0 * true
