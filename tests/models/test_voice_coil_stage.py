"""The flexure stage: its control loop against python-control, and SciPy for a rigid stage."""

import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from voice_coil_stage import EVERY, voice_coil_stage

import beamdae as bd

GAINS = {name: voice_coil_stage.parameters[name] for name in ("kp", "ki", "kd")}
STEP = voice_coil_stage.parameters["step"]


@pytest.fixture(scope="module")
def plant():
    """Return the linear stage of python-control, from the force to position and velocity."""
    outputs = ["position", "velocity"]
    linear = bd.linearize(voice_coil_stage(control="none"), inputs=["force"], outputs=outputs)
    return control.ss(*linear, inputs="force", outputs=outputs)


@pytest.fixture(scope="module")
def loop(plant):
    """Return the closed loop, from the target to the position."""
    s = control.tf("s")
    position_control = control.ss(GAINS["kp"] + GAINS["ki"] / s, inputs="error", outputs="push")
    blocks = [
        plant,
        position_control,
        control.summing_junction(["target", "-position"], "error"),
        control.summing_junction(["push", "-brake"], "force"),
        control.ss([], [], [], [[GAINS["kd"]]], inputs="velocity", outputs="brake"),
    ]
    return control.interconnect(blocks, inputs="target", outputs="position")


@pytest.mark.slow
def test_poles_of_the_closed_loop(loop):
    linear = bd.linearize(voice_coil_stage(step=0.0), inputs=["target"], outputs=["position"])
    poles, expected = linear.poles, loop.poles()
    # The control loop has the slowest poles; the next ones are those of the modes of the leaves.
    slow, expected = (np.sort_complex(x[np.abs(x) < 2e3]) for x in (poles, expected))
    assert len(slow) == 3
    assert np.all(slow.real < -50.0)
    # Rounding errors of eigenvalues of matrices whose elements reach 3e17 1/s^2: 4e-5.
    assert_allclose(slow, expected, rtol=2e-4)
    frequencies = np.array([1.0, 10.0, 30.0, 100.0, 300.0])
    response = linear.frequency_response(frequencies)[:, 0, 0]
    assert_allclose(response, loop(2j * np.pi * frequencies), rtol=1e-8)


@pytest.mark.slow
def test_step_response(loop):
    run = bd.simulate(voice_coil_stage, bd.Radau(1e-7), t_end=0.03, output_step=1e-3)
    expected = STEP * control.step_response(loop, run.t).outputs
    # The same rounding errors in the matrix exponential of python-control: 1.2e-4. The nonlinearity
    # is 4e-6, and the residues of the refined poles agree with a small step to 2e-6.
    assert_allclose(run["position"], expected, rtol=0, atol=3e-4 * STEP)


@pytest.mark.slow
def test_rigid_stage_with_springs():
    """The leaves as massless springs 12 EI / L^3, and 13/35 of their masses at the platform."""
    width, thickness, length = 0.02, 0.3e-3, 0.04
    stiffness = 24.0 * 210e9 * width * thickness**3 / 12.0 / length**3
    mass = 0.5 + 2.0 * 13.0 / 35.0 * 7850.0 * width * thickness * length

    def accelerate(t, state):
        x, rate, integral = state
        force = GAINS["kp"] * (STEP - x) + GAINS["ki"] * integral - GAINS["kd"] * rate
        return [rate, (force - stiffness * x) / mass, STEP - x]

    run = bd.simulate(voice_coil_stage, bd.Radau(1e-7), t_end=0.03, output_step=1e-3)
    expected = solve_ivp(accelerate, (0.0, 0.03), np.zeros(3), t_eval=run.t, rtol=1e-9, atol=1e-14)
    # The equivalent neglects shear and damping of the leaves and the rotation of the platform.
    assert_allclose(run["position"], expected.y[0], rtol=0, atol=1e-3 * STEP)


def test_sampled_control_is_that_of_the_sampled_linear_stage(plant):
    stage = voice_coil_stage(control="sampled", resolution=1e-15)
    settings = bd.GeneralizedAlpha(1e-4, newton_tolerance=1e-9)
    run = bd.simulate(stage, settings, t_end=0.02, output_step=EVERY)
    sampled = control.sample_system(plant, EVERY, "zoh")
    x, integral, last, positions = np.zeros(sampled.nstates), 0.0, 0.0, []
    for _ in run.t:
        position = (sampled.C @ x)[0]
        positions.append(position)
        error, rate = STEP - position, (position - last) / EVERY
        force = GAINS["kp"] * error + GAINS["ki"] * integral - GAINS["kd"] * rate
        integral, last = integral + EVERY * error, position
        x = sampled.A @ x + sampled.B[:, 0] * force
    # Steps of 0.1 ms, one tenth of the time of the closed loop, have an error of 1e-3.
    assert_allclose(run["position"], positions, rtol=0, atol=2e-3 * STEP)


@pytest.mark.slow
def test_saturated_coil():
    run = bd.simulate(voice_coil_stage(step=1e-3), bd.Radau(), t_end=0.01)
    assert np.max(run["coil.Fx"]) == 15.0


@pytest.mark.slow
@pytest.mark.parametrize("ki", [1.5e6, 1e5])
def test_regression_modes_of_a_stiff_stage_with_states_are_accurate(ki):
    # The slow poles were up to 1.6 % off, and that at -3.6 1/s was zero: a free motion.
    stage = voice_coil_stage(ki=ki)
    modes = bd.modes(stage)
    poles = bd.linearize(stage, inputs=["target"], outputs=["position"]).poles
    slow = np.sort_complex(poles[(np.abs(poles) < 1e3) & (poles.imag >= 0.0)])
    values = modes.eigenvalues[np.abs(modes.eigenvalues) < 1e3]
    assert_allclose(np.sort_complex(values), slow, rtol=5e-4)
    assert "free motion" not in modes.kinds
