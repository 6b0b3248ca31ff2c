"""The press against an ordinary differential equation of its crank angle, solved by SciPy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from press import FORCE, TRAVEL, press
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import beamdae as bd

RADIUS, ROD, RAM, INERTIA, SLIP, SPEED = 0.05, 0.30, 40.0, 20.0, 20.0, 12.0
MEASURED = PchipInterpolator(1e-3 * np.array(TRAVEL), 1e3 * np.array(FORCE))


def accelerate(t, state):
    """Return rate and acceleration of the crank: (J + m s'^2) phi'' + m s' s'' phi'^2 = Q."""
    angle, rate = state
    x, dx, ddx = RADIUS * np.array([-np.sin(angle), -np.cos(angle), np.sin(angle)])
    y, dy, ddy = RADIUS * np.array([np.cos(angle), -np.sin(angle), -np.cos(angle)])
    # Height of the pin above the ram.
    height = np.sqrt(ROD**2 - x**2)
    slope = -x * dx / height
    s, ds = y - height, dy - slope
    dds = ddy + (dx**2 + x * ddx + slope**2) / height
    travel = np.clip(6e-3 - RADIUS - ROD - s, 0.0, 1e-3 * TRAVEL[-1])
    force = 0.5 * (1.0 - np.tanh(100.0 * ds * rate)) * MEASURED(travel)
    moment = (force - 9.81 * RAM) * ds + SLIP * (SPEED - rate)
    return [rate, (moment - RAM * ds * dds * rate**2) / (INERTIA + RAM * ds**2)]


@pytest.fixture(scope="module")
def exact():
    t = np.linspace(0.0, 0.4, 201)
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12, "max_step": 1e-3}
    return solve_ivp(accelerate, (0.0, 0.4), [0.0, SPEED], t_eval=t, **options)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("integrator", "tolerance"),
    [
        # Differences of 2e-8 and 4e-7 rad/s of the 2.2 rad/s that a stroke costs.
        (bd.Radau(1e-8), 1e-7),
        (bd.Ida(1e-7), 2e-6),
        # Second order: 1e-4 rad/s at steps of 0.1 ms.
        (bd.GeneralizedAlpha(step=1e-4), 5e-4),
    ],
    ids=lambda x: getattr(x, "method", None),
)
def test_first_stroke_is_that_of_the_rigid_crank(exact, integrator, tolerance):
    solution = bd.simulate(press, integrator, t_end=0.4, output_step=2e-3)
    table = solution.table()
    assert_allclose(table["wheel.angle [rad]"], exact.y[0], rtol=0, atol=tolerance)
    assert_allclose(table["wheel.angle_dot [rad/s]"], exact.y[1], rtol=0, atol=tolerance)
    # The stroke has happened.
    assert np.ptp(exact.y[1]) > 1.0
