"""User-defined fixed-step methods that are compiled from one step function."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.integrators.compiled_method import FixedStepMethod, solve_stage
from beamdae.native.loop_functions import combine
from beamdae.native.object_code import is_native_enabled
from beamdae.native.return_codes import DONE


def take_euler_step(run, t, h):
    """Implicit Euler method: y' = (y - y_n) / h."""
    stage = run.end_point
    combine(stage.offset, (-1.0 / h,), (run.y,))
    combine(stage.y, (1.0, h), (run.y, run.yp))
    code = solve_stage(run, stage, t + h, 1.0 / h)
    if code != DONE:
        return code
    combine(run.y, (1.0,), (stage.y,))
    combine(run.yp, (1.0,), (stage.yp,))
    return DONE


METHODS = []


@dataclass(frozen=True)
class Euler(bd.Integrator):
    step: float = 1e-3
    order = 1

    def method_on(self, plan):
        METHODS.append(FixedStepMethod(plan, take_euler_step, self.step, stages=("end_point",)))
        return METHODS[-1]


def falling_pendulum(law=0.0):
    """A rod of 1 m and 1 kg on a hinge, released from the horizontal, with a moment on it."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    rod = mech.add(bd.RigidBody("rod", mass=1.0, inertia=0.1, center=(0.5, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    mech.add(bd.Moment("moment", rod.at(0.5, 0.0), law=law))
    return mech


@pytest.mark.skipif(not is_native_enabled(), reason="without machine code")
def test_step_function_runs_in_machine_code():
    bd.simulate(falling_pendulum(), Euler(), 0.01)
    assert METHODS[-1].is_native


def test_error_is_first_order():
    exact = bd.simulate(falling_pendulum(), bd.Radau(1e-9), 0.5, 0.05)
    errors = []
    for step in (2e-3, 1e-3):
        solution = bd.simulate(falling_pendulum(), Euler(step), 0.5, 0.05)
        differences = (solution.q - exact.q, solution.v - exact.v, (solution.lam - exact.lam)[1:])
        errors.append([np.max(np.abs(difference)) for difference in differences])
    assert_allclose(np.log2(np.divide(*errors)), 1.0, rtol=0.0, atol=0.1)


def test_interpreted_steps_equal_compiled_steps(monkeypatch):
    compiled = bd.simulate(falling_pendulum(), Euler(), 0.2)
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    interpreted = bd.simulate(falling_pendulum(), Euler(), 0.2)
    assert not METHODS[-1].is_native
    assert_allclose(interpreted.q, compiled.q, rtol=0.0, atol=1e-10)
    assert interpreted.statistics.residual_calls == compiled.statistics.residual_calls


def test_statistics_count_calls_and_factors_are_reused():
    statistics = bd.simulate(falling_pendulum(), Euler(), 0.2).statistics
    assert statistics.steps == 200
    assert statistics.residual_calls >= statistics.steps
    assert statistics.solves == statistics.residual_calls
    assert 0 < statistics.factorizations < statistics.steps


def test_nonfinite_residual_fails_the_run_and_keeps_the_steps():
    solution = bd.simulate(falling_pendulum(lambda t: np.sqrt(0.1 - t)), Euler(), 0.2)
    assert solution.status.kind == "failed"
    assert "not finite" in solution.status.sentence
    assert 0.098 < solution.trajectory.end <= 0.1


@pytest.mark.parametrize("native", ["on", "off"])
def test_failed_step_names_the_equation_with_the_largest_residual(native, monkeypatch):
    """The moment of the stop jumps by 300 N m, so that Newton's iteration cannot balance it."""
    monkeypatch.setenv("BEAMDAE_NATIVE", native)
    mech = falling_pendulum()
    points = mech.ground.at(0.0, 0.0), mech.parts["rod"].at(0.0, 0.0)

    def law(angle, rate):
        return 100.0 * np.arctan(1e6 * (angle + 0.5))

    mech.add(bd.TorsionSpring("stop", *points, law=law))
    solution = bd.simulate(mech, Euler(1e-2), 1.0)
    assert "Newton's iteration did not converge" in solution.status.sentence
    assert "largest residual is in the balance of forces on rod.angle" in solution.status.sentence


def test_step_too_short_for_the_run_is_rejected():
    with pytest.raises(bd.BeamdaeError, match=r"^take_euler_step: step of 1e-12 s requires 1e"):
        bd.simulate(falling_pendulum(), Euler(1e-12), 1.0)
