"""Mechanisms whose motion is known, with every integrator."""

import numpy as np
import pytest
from benchmarks.mechanism_cases import MECHANISM_CASES
from benchmarks.mechanisms import moving_load
from conformance import integrators

import beamdae as bd

STEP, RTOL = 2.5e-4, 1e-6
OF_BEAMS = ("moving load", "follower load")
every_case = pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            marks=[pytest.mark.slow(reason="runs of seconds")] if case.name in OF_BEAMS else [],
        )
        for case in MECHANISM_CASES
    ],
    ids=lambda case: case.name,
)


@every_case
@integrators(RTOL, STEP, newton_tolerance=1e-9)
def test_every_integrator_finds_the_motion(case, integrator):
    solution = case.run(integrator)
    # Of fixed steps ten times the error of phase of the trapezoidal rule: friction that turns round
    # takes a share of a step.
    phase = 10.0 * (case.rate * STEP) ** 2 / 12.0 * case.rate * case.t_end
    bound = 100.0 * RTOL if integrator.accuracy.name == "rtol" else phase
    for name, (known, found) in case.compare(solution).items():
        error = np.max(np.abs(found - known)) / np.max(np.abs(known))
        # Forces are not tested.
        share = 10.0 if "[N" in name else 1.0
        assert error < case.model_error + share * max(bound, 1e-6), name
    # Work goes with the square of the motion.
    assert solution.quality.energy_imbalance < 10.0 * max(bound, 1e-5)


@pytest.mark.slow(reason="a beam whose whole spectrum takes part")
@integrators(1e-4, 2e-3)
def test_a_load_that_moves_the_other_way(integrator):
    there, back = (
        bd.simulate(moving_load(speed=speed), integrator, 4.0 / 3.0, 0.05) for speed in (3.0, -3.0)
    )
    y = "middle.y [m]"
    size = np.abs(there.columns[y]).max()
    np.testing.assert_allclose(back.columns[y], there.columns[y], rtol=0.0, atol=1e-3 * size)
