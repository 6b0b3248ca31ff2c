"""The inverted pendulum: gains and poles by python-control, and SciPy for a rigid strip."""

import control
import numpy as np
import pytest
from inverted_pendulum import EVERY, GAINS, NOISE, inverted_pendulum
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import beamdae as bd

CART, BOB, RADIUS, LENGTH, GRAVITY = 0.8, 0.06, 0.02, 0.5, 9.81
STRIP = 7850.0 * 0.02 * 1e-3 * LENGTH
READS = ["position", "velocity", "angle", "rate"]


def linearize_plant(about=None, **parameters):
    """Return the upright pendulum as a linear model, from the force to the sensors."""
    mech = inverted_pendulum(control="none", tilt=0.0, **parameters)
    about = "reference" if about is None else about(mech)
    return bd.linearize(mech, about, inputs=["force"], outputs=READS)


def find_upright(mech):
    """Return the upright equilibrium under the whole weight."""
    return bd.equilibrium(mech, loads=[])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:cart.x. this coordinate can move without stiffness")
def test_regression_path_of_growing_weight_does_not_move_the_cart():
    # The cart has no stiffness. Without a spring that holds it, paths ended at load factors of
    # 0.0016 or 0.1, depending on rounding.
    path = bd.equilibrium(inverted_pendulum(control="none", tilt=0.0, elements=1))
    assert path.status.success
    assert set(path.free_coordinates) == {"cart.x"}
    assert np.max(np.abs(path["cart.x"])) < 1e-12
    assert path.unstable[-1] == 1  # it falls over


def test_gains_are_those_of_the_regulator():
    linear = linearize_plant(rigid=True)
    # Four states: the sensors are states in other coordinates.
    A = linear.C @ linear.A @ np.linalg.inv(linear.C)
    B = linear.C @ linear.B
    gains, _, _ = control.lqr(A, B, np.diag([100.0, 1.0, 100.0, 1.0]), [[1.0]])
    # The stored gains are rounded to four decimals.
    assert_allclose(gains[0], GAINS, rtol=0, atol=1e-4)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:cart.x. this coordinate can move without stiffness")
def test_poles_of_the_flexible_pendulum():
    plant = linearize_plant(find_upright)
    # Uncontrolled, the pendulum falls over, as the rigid one but 0.05 % faster.
    falling, rigid = (np.max(x.poles.real) for x in (plant, linearize_plant(rigid=True)))
    assert 1.0001 < falling / rigid < 1.001
    upright = inverted_pendulum(tilt=0.0)
    equilibrium = find_upright(upright)
    linear = bd.linearize(upright, equilibrium)
    feedback = control.ss([], [], [], [GAINS])
    loop = control.feedback(control.ss(*plant), feedback)
    # Elements of A are so large that rounding errors of its own eigenvalues are 1e-3.
    loop_poles = 1.0 / np.linalg.eigvals(np.linalg.inv(loop.A))
    slow, expected = (np.sort_complex(x[np.abs(x) < 300.0]) for x in (linear.poles, loop_poles))
    # Four poles of the regulator and two of each of two bending modes.
    assert len(slow) == 8
    assert np.all(slow.real < -2.0)
    assert_allclose(slow, expected, rtol=1e-5)
    modes = bd.modes(upright, equilibrium, n=4).eigenvalues
    assert_allclose(np.sort_complex(modes), slow[slow.imag > 0.0], rtol=2e-6)


def fall(t, state):
    """Return the rates of position, velocity, angle from the vertical and rate of a rigid strip."""
    _, velocity, angle, rate = state
    force = -np.dot(GAINS, state)
    moment = (BOB + 0.5 * STRIP) * LENGTH
    inertia = (BOB + STRIP / 3.0) * LENGTH**2 + 0.5 * BOB * RADIUS**2
    coupling = -moment * np.cos(angle)
    mass = [[CART + BOB + STRIP, coupling], [coupling, inertia]]
    forces = [force - moment * rate**2 * np.sin(angle), moment * GRAVITY * np.sin(angle)]
    accelerations = np.linalg.solve(mass, forces)
    return [velocity, accelerations[0], rate, accelerations[1]]


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [0.1, 0.6])
def test_rigid_strip(tilt):
    run = bd.simulate(inverted_pendulum(rigid=True, tilt=tilt), bd.Radau(1e-8), 2.0, 0.02)
    start = [0.0, 0.0, -tilt, 0.0]
    exact = solve_ivp(fall, (0.0, 2.0), start, t_eval=run.t, rtol=1e-10, atol=1e-12)
    assert_allclose(run["position"], exact.y[0], rtol=0, atol=1e-7)
    assert_allclose(run["angle"] - tilt, exact.y[2], rtol=0, atol=1e-7)


@pytest.mark.slow
def test_flexible_strip_follows_the_rigid_one():
    run = bd.simulate(inverted_pendulum, bd.Radau(), output_step=0.02)
    exact = solve_ivp(fall, (0.0, 2.0), [0.0, 0.0, -0.1, 0.0], t_eval=run.t, rtol=1e-9)
    # The strip bends by 2.6 mm, 2.4 % of the travel of 111 mm.
    assert_allclose(run["position"], exact.y[0], rtol=0, atol=0.03 * np.ptp(exact.y[0]))
    assert np.ptp(run["deflection.transverse"]) > 3e-3


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_sampled_control_is_that_of_the_sampled_linear_pendulum(noise):
    tilt, t_end, seed = 1e-4, 0.2, 7
    pendulum = inverted_pendulum(
        control="sampled", rigid=True, tilt=tilt, noise=1e-3 * noise, seed=seed
    )
    settings = bd.GeneralizedAlpha(2e-3, rho_inf=1.0, newton_tolerance=1e-10)
    run = bd.simulate(pendulum, settings, t_end=t_end, output_step=EVERY)
    plant = linearize_plant(rigid=True)
    sampled = control.sample_system(control.ss(*plant), EVERY, "zoh")
    x, measured = np.linalg.solve(plant.C, [0.0, 0.0, -tilt, 0.0]), []
    for index in range(len(run.t)):
        reads = sampled.C @ x
        measured.append(reads)
        random = np.random.default_rng((seed, index))
        reads = reads + 1e-3 * noise * np.array(NOISE) * random.normal(size=4)
        x = sampled.A @ x - sampled.B[:, 0] * np.dot(GAINS, reads)
    measured = np.array(measured)
    for k, name in enumerate(READS):
        shift = tilt if name == "angle" else 0.0
        atol = 1e-3 * np.max(np.abs(measured[:, k]))
        assert_allclose(run[name] - shift, measured[:, k], rtol=0, atol=atol)


@pytest.mark.slow
def test_noise_is_that_of_the_seed():
    runs = [
        bd.simulate(
            inverted_pendulum(control="sampled", rigid=True, seed=seed),
            bd.GeneralizedAlpha(5e-3),
            t_end=0.1,
        )["position"].to_numpy()
        for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert np.max(np.abs(runs[0] - runs[2])) > 1e-5
