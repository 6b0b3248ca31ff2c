"""Accuracy of every integrator on every published case."""

from functools import cache, partial

import numpy as np
import pytest
from benchmarks.cases import (
    IFTOMM_PENDULUM,
    PENDULUM,
    PERIOD_TWO_GRAVITY,
    PUBLISHED_CASES,
    pendulum_motion,
)
from numpy.testing import assert_allclose

import beamdae as bd

RTOLS = (
    1e-4,
    1e-6,
    pytest.param(1e-8, marks=pytest.mark.slow(reason="takes as long as all others together")),
)


# Another pendulum is among the other cases; this one swings for ten seconds.
every_case = pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            id=case.name,
            marks=[pytest.mark.slow(reason="takes as long as all others together")]
            if case is IFTOMM_PENDULUM
            else [],
        )
        for case in PUBLISHED_CASES
    ],
)


def ida(rtol, formulation="stabilized-index1"):
    # The limit turns a very slow run into a failed one.
    return bd.Ida(
        rtol=rtol,
        formulation=formulation,
        # Velocities of "index3" are algebraic, and rounding in their difference quotients stops
        # the run at small steps.
        error_control="positions" if formulation == "index3" else "velocities",
        max_order=5,
        max_steps=30_000,
    )


@cache
def relative_errors(case, integrator):
    """Return the largest error of each quantity relative to its size."""
    exact = case.answer(np.array(case.times))
    errors = case.errors(case.run(integrator))
    return {name: errors[name] / max(1e-9, np.max(np.abs(exact[name]))) for name in errors}


def test_closed_forms_agree_with_an_independent_integration():
    for case, gravity, angle in (
        (PENDULUM, PERIOD_TWO_GRAVITY, 0.5 * np.pi),
        (IFTOMM_PENDULUM, 9.81, -0.5 * np.pi),
    ):
        t = np.array(case.times)
        motion = pendulum_motion(gravity, angle, 0.0, t)
        for name, exact in case.answer(t).items():
            # Runge-Kutta at 1e-13, its error grown over a few periods.
            assert_allclose(motion[name], exact, rtol=0.0, atol=1e-9)


# rtol bounds the error of a step. Errors of about ten swings accumulate in the phase, and with
# "index1", positions also drift off the constraints. Multipliers are never tested: those of Ida are
# algebraic, with the error of the velocities divided by the step, those of Radau of order 3.
SETTINGS = {
    "stabilized-index1": (ida, 100.0),
    "ggl": (partial(ida, formulation="ggl"), 100.0),
    "index2": (partial(ida, formulation="index2"), 100.0),
    "index1": (partial(ida, formulation="index1"), 500.0),
    "default": (partial(bd.Ida, max_steps=30_000), 100.0),
    "radau": (partial(bd.Radau, max_steps=10_000), 100.0),
    "radau positions": (partial(bd.Radau, error_control="positions", max_steps=10_000), 100.0),
}


@pytest.mark.parametrize("rtol", RTOLS)
@pytest.mark.parametrize(
    "settings",
    # The formulations for comparisons are slow tests.
    [
        pytest.param(
            name,
            marks=[pytest.mark.slow(reason="several runs")] if name in ("index1", "index2") else [],
        )
        for name in SETTINGS
    ],
)
@every_case
def test_errors_are_in_proportion_to_the_tolerance(case, settings, rtol):
    integrator, factor = SETTINGS[settings]
    errors = relative_errors(case, integrator(rtol))
    assert max(errors["q"], errors.get("v", 0.0)) < factor * rtol
    if settings != "default":
        assert errors.get("lam", 0.0) < 10.0 * factor * rtol


@pytest.mark.parametrize("rtol", RTOLS)
@every_case
def test_ida_on_index_3_meets_the_case_with_looser_bounds(case, rtol):
    # Only positions are tested: velocities have the error rtol / h with h ~ rtol^(1/6), and so
    # have the positions after a run.
    errors = relative_errors(case, ida(rtol, "index3"))
    assert max(errors["q"], errors.get("v", 0.0)) < 10.0 * np.sqrt(rtol)


@pytest.mark.parametrize("formulation", ["index3", "stabilized-index2"])
@pytest.mark.parametrize(
    "step", [8e-3, pytest.param(4e-3, marks=pytest.mark.slow(reason="several runs"))]
)
@every_case
def test_generalized_alpha_meets_the_case_to_second_order(case, formulation, step):
    integrator = bd.GeneralizedAlpha(step=step, formulation=formulation, newton_tolerance=1e-8)
    errors = relative_errors(case, integrator)
    # Three times the phase error of the trapezoidal rule, (omega h)^2 / 12 of omega t; this bound
    # also holds for multipliers. The ratio is the same for all steps from 8 ms to 1 ms.
    max_error = 3.0 * (case.rate * step) ** 2 / 12.0 * case.rate * case.t_end
    assert max(errors.values()) < max_error


@pytest.mark.parametrize(
    "integrator",
    [ida(1e-6, "ggl"), ida(1e-6, "stabilized-index1"), bd.Radau(1e-6)],
    ids=["ida ggl", "ida stabilized-index1", "radau"],
)
def test_stabilized_forms_keep_positions_and_velocities_on_the_constraints(integrator):
    solution = PENDULUM.run(integrator)
    # Newton's iteration satisfies them to a fraction of the local tolerance.
    assert solution.quality.max_position_drift < 1e-6
    assert solution.quality.max_velocity_drift < 1e-5
