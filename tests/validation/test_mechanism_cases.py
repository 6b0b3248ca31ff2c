"""Mechanisms with closed-form motions, by every integrator."""

import numpy as np
import pytest
from benchmarks.mechanism_cases import MECHANISM_CASES
from benchmarks.mechanisms import moving_load
from conformance import integrators

import beamdae as bd

STEP, RTOL = 2.5e-4, 1e-6
BEAM_CASES = ("moving load", "follower load")
every_case = pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            marks=[pytest.mark.slow] if case.name in BEAM_CASES else [],
        )
        for case in MECHANISM_CASES
    ],
    ids=lambda case: case.name,
)


@every_case
@integrators(RTOL, STEP, newton_tolerance=1e-9)
def test_motion_matches_closed_form(case, integrator):
    solution = case.run(integrator)
    # Fixed steps: ten times the phase error of the trapezoidal rule, because a reversal of friction
    # may occur within a step.
    phase_error = 10.0 * (case.rate * STEP) ** 2 / 12.0 * case.rate * case.t_end
    bound = 100.0 * RTOL if integrator.accuracy.name == "rtol" else phase_error
    for name, (published, computed) in case.compare(solution).items():
        error = np.max(np.abs(computed - published)) / np.max(np.abs(published))
        # The error test does not include forces.
        factor = 10.0 if "[N" in name else 1.0
        assert error < case.model_error + factor * max(bound, 1e-6), name
    # Work is quadratic in the motion.
    assert solution.quality.energy_imbalance < 10.0 * max(bound, 1e-5)


@pytest.mark.slow
@integrators(1e-4, 2e-3)
def test_load_in_the_opposite_direction_gives_the_same_deflection(integrator):
    forward, backward = (
        bd.simulate(moving_load(speed=speed), integrator, 4.0 / 3.0, 0.05) for speed in (3.0, -3.0)
    )
    y = "middle.y [m]"
    amplitude = np.abs(forward.columns[y]).max()
    np.testing.assert_allclose(
        backward.columns[y], forward.columns[y], rtol=0.0, atol=1e-3 * amplitude
    )
