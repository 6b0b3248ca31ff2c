"""Active damping by strain feedback: poles by python-control, and SciPy for one bending mode."""

import control
import numpy as np
import pytest
from active_damping import active_damping
from mechanisms import rectangle
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import beamdae as bd

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
