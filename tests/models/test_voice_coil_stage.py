"""The flexure stage: its control loop against python-control, and SciPy for a rigid stage."""

import control
import numpy as np
import pytest
from active_damping import active_damping
from mechanisms import rectangle
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


@pytest.mark.slow(reason="a fifth of a second")
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


@pytest.mark.slow(reason="a quarter of a second")
def test_step_response(loop):
    run = bd.simulate(voice_coil_stage, bd.Radau(1e-7), t_end=0.03, output_step=1e-3)
    expected = STEP * control.step_response(loop, run.t).outputs
    # The same rounding errors in the matrix exponential of python-control: 1.2e-4. The nonlinearity
    # is 4e-6, and the residues of the refined poles agree with a small step to 2e-6.
    assert_allclose(run["position"], expected, rtol=0, atol=3e-4 * STEP)


@pytest.mark.slow(reason="a fifth of a second")
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


@pytest.mark.slow(reason="a fifth of a second")
def test_saturated_coil():
    run = bd.simulate(voice_coil_stage(step=1e-3), bd.Radau(), t_end=0.01)
    assert np.max(run["coil.Fx"]) == 15.0


@pytest.mark.slow(reason="half a second each")
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


# Active damping by strain feedback: poles by python-control, and SciPy for one bending mode.

VALUES = active_damping.parameters
FREQUENCY, RATIO, GAIN = (VALUES[name] for name in ("frequency", "ratio", "gain"))
LENGTH, PATCH, HEIGHT = 0.3, 0.06, 0.002
ALUMINUM = bd.Material.of("aluminum")
SECTION = rectangle(HEIGHT, 0.03, material=ALUMINUM)


def slow_poles(poles):
    """Return the poles of the first two bending modes and of the filter."""
    return np.sort_complex(poles[np.abs(poles) < 1e3])


def test_closed_loop_is_that_of_python_control():
    still = active_damping(strike=0.0)
    linear = bd.linearize(still, inputs=["strike"], outputs=["strain"])
    passive = bd.linearize(
        active_damping(gain=0.0, strike=0.0), inputs=["strike", "patch"], outputs=["strain"]
    )
    assert [x.name for x in passive.inputs] == ["strike.Fx", "strike.Fy", "patch.M"]
    A, B, C, D = passive
    inputs = ["strike", "patch"]
    strip = control.ss(A, B[:, 1:], C, D[:, 1:], inputs=inputs, outputs="strain")
    square = FREQUENCY**2
    stiffness = 2.0 * SECTION.EI / HEIGHT
    law = control.tf([-GAIN * stiffness * square], [1.0, 2.0 * RATIO * FREQUENCY, square])
    law = control.ss(law, inputs="strain", outputs="patch")
    loop = control.interconnect([strip, law], inputs="strike", outputs="strain")
    frequencies = np.array([1.0, 8.0, 10.0, 12.0, 86.0, 200.0])
    response = linear.frequency_response(frequencies)[:, 0, 1]
    assert_allclose(response, loop(2j * np.pi * frequencies), rtol=1e-7)
    poles = slow_poles(linear.poles)
    # Without gain, the filter of the model is an observer, whose two poles remain. Errors of the
    # eigenvalues are due to rounding, because elements of A are large.
    distances = np.abs(poles[:, None] - slow_poles(loop.poles()))
    assert np.all(np.min(distances, axis=1) < 1e-3 * np.abs(poles))
    # Two modes of the strip and one of the filter; those at 60 rad/s are damped by a tenth.
    assert len(poles) == 6
    ratios = -poles.real / np.abs(poles)
    assert np.min(ratios[np.abs(poles) < 100.0]) > 0.08


@pytest.mark.slow(reason="two runs of many vibrations")
def test_one_mode_of_a_thin_strip():
    """Static deflection under the end force, with 33/140 of the mass of the strip at its end."""
    bending = SECTION.EI
    stiffness = 3.0 * bending / LENGTH**3
    mass = 0.03 + 33.0 / 140.0 * SECTION.rhoA * LENGTH

    def accelerate(t, state):
        deflection, rate, filtered, filtered_rate = state
        # Curvature that the patch adds between the clamp and its end.
        added = GAIN * filtered
        force = stiffness * (deflection - added * PATCH * (LENGTH - 0.5 * PATCH))
        curvature = force * (LENGTH - 0.5 * PATCH) / bending + added
        return [
            rate,
            (-2.0 * (t < 5e-3) - force) / mass,
            filtered_rate,
            FREQUENCY**2 * (curvature - filtered) - 2.0 * RATIO * FREQUENCY * filtered_rate,
        ]

    run = bd.simulate(active_damping, bd.Radau(), t_end=0.4, output_step=5e-3)
    options = {"t_eval": run.t, "rtol": 1e-8, "atol": 1e-10, "max_step": 1e-3}
    exact = solve_ivp(accelerate, (0.0, 0.4), np.zeros(4), **options)
    # The second mode and the inertia of the end mass and of the strip are neglected.
    assert_allclose(run["end.y"], exact.y[0], rtol=0, atol=0.05 * np.ptp(exact.y[0]))
    # Without feedback, the amplitude hardly decreases.
    passive = bd.simulate(active_damping(gain=0.0), bd.Radau(), t_end=0.4, output_step=5e-3)
    active, free = (np.ptp(x["end.y"][run.t > 0.3]) for x in (run, passive))
    assert active < 0.15 * free
