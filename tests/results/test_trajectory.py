"""What lies between the steps."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.equations.formulations import State
from beamdae.integrators.drive import plan
from beamdae.results.trajectory import Interval, Trajectory, accumulate, interpolate


def interval(t, q, lam=None, branch=0.5):
    """Segment of the functions q (with its derivatives) and lam."""
    rows = State(*(np.stack([f(t)], axis=-1) for f in q), np.stack([(lam or q[0])(t)], axis=-1))
    return Interval(t, rows, branch)


def polynomial(degree, seed=0):
    p = Polynomial(np.random.default_rng(seed).normal(size=degree + 1))
    return p, p.deriv(), p.deriv(2)


UNEVEN = np.array([0.0, 0.1, 0.15, 0.4, 0.9, 1.0])
BETWEEN = np.linspace(0.0, 1.0, 137)


def test_a_polynomial_of_degree_five_is_reproduced():
    q = polynomial(5)
    state = interval(UNEVEN, q).at(BETWEEN)
    for found, exact in zip(state[:3], q, strict=True):
        # Accelerations divide by the square of the shortest step, 0.05.
        assert_allclose(found[:, 0], exact(BETWEEN), rtol=0.0, atol=1e-11)


def test_a_polynomial_of_degree_six_is_not():
    q = polynomial(6)
    difference = interval(UNEVEN, q).at(BETWEEN).q[:, 0] - q[0](BETWEEN)
    assert np.max(np.abs(difference)) > 1e-6


def test_cubic_multipliers_are_reproduced():
    lam = polynomial(3)[0]
    found = interval(UNEVEN, polynomial(2), lam).at(BETWEEN).lam
    assert_allclose(found[:, 0], lam(BETWEEN), rtol=0.0, atol=1e-13)


def test_orders_of_the_interpolation():
    q = (np.sin, np.cos, lambda t: -np.sin(t))
    at = np.linspace(0.0, 4.0, 1001)
    exact = State(*(f(at) for f in q), np.sin(at))
    errors = []
    for steps in (32, 64):
        state = interval(np.linspace(0.0, 4.0, steps + 1), q).at(at)
        errors.append([np.max(np.abs(f[:, 0] - e)) for f, e in zip(state, exact, strict=True)])
    orders = np.log2(np.divide(*errors))
    # Quintic Hermite: 6 in q, one less for each derivative; cubic spline: 4 in lam.
    assert_allclose(orders, [6.0, 5.0, 4.0, 4.0], rtol=0.0, atol=0.2)


def test_steps_themselves_are_returned_unchanged():
    q = polynomial(7)
    given = interval(UNEVEN, q)
    for found, row in zip(given.at(UNEVEN), given.state, strict=True):
        assert_allclose(found, row, rtol=0.0, atol=1e-11)


def test_a_run_stopped_at_its_start_has_its_first_state():
    q = polynomial(2)
    state = interval(np.array([0.2]), q).at(np.array([0.2]))
    assert_allclose(state.q, [[q[0](0.2)]], rtol=1e-15)


@pytest.mark.parametrize("steps", [2, 3])
def test_few_rows_are_joined_by_straight_lines(steps):
    t = np.linspace(0.0, 1.0, steps)
    values = np.stack([2.0 * t, 1.0 - t], axis=-1)
    at = np.array([0.2, 0.7])
    assert_allclose(interpolate(t, values, at), [[0.4, 0.8], [1.4, 0.3]], rtol=1e-14)
    assert_allclose(accumulate(t, values)[-1], [1.0, 0.5], rtol=1e-14)


def test_no_columns_stay_no_columns():
    t = np.linspace(0.0, 1.0, 3)
    assert interpolate(t, np.zeros((3, 0)), np.array([0.5, 0.6])).shape == (2, 0)
    assert accumulate(t, np.zeros((3, 0))).shape == (3, 0)


def test_integrals_of_cubics_are_exact():
    rate = polynomial(3)[0]
    found = accumulate(UNEVEN, np.stack([rate(UNEVEN), 0.0 * UNEVEN], axis=-1))
    assert_allclose(found[:, 0], rate.integ()(UNEVEN), rtol=0.0, atol=1e-14)
    assert_allclose(found[:, 1], 0.0, rtol=0.0, atol=0.0)


def test_a_trajectory_takes_each_time_from_its_interval():
    rising, falling = Polynomial([0.0, 1.0]), Polynomial([2.0, -1.0])
    still = Polynomial([0.0])
    t = np.linspace(0.0, 1.0, 5)
    first = interval(t, (rising, rising.deriv(), still), still, branch=0.5)
    # The reaction jumps at t = 1.
    second = interval(t + 1.0, (falling, falling.deriv(), still), still + 7.0, branch=1.5)
    times = np.array([0.0, 0.5, 1.0, 1.25, 2.0])
    rows, state = Trajectory((first, second)).at(times)
    assert_allclose(rows[:, 0], times, rtol=0.0, atol=0.0)
    # A breakpoint still belongs to what came before it.
    assert_allclose(rows[:, 1], [0.5, 0.5, 0.5, 1.5, 1.5], rtol=0.0, atol=0.0)
    assert_allclose(state.q[:, 0], [0.0, 0.5, 1.0, 0.75, 0.0], rtol=0.0, atol=1e-14)
    assert_allclose(state.lam[:, 0], [0.0, 0.0, 0.0, 7.0, 7.0], rtol=0.0, atol=1e-14)
    assert Trajectory((first, second)).end == 2.0


def test_intervals_end_on_the_breakpoints_inside_the_run():
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("body", 1.0, at=(0.0, 0.0)))
    early = bd.piecewise((0.0, 0.0), (0.5, 1.0), 0.0)
    late = bd.piecewise((0.25, 0.0), (0.5, 2.0), (3.0, 1.0), 0.0)
    mech.add(bd.Force("push", body.point, (early, late)))
    equations = bd.equations_of_motion(mech)
    assert plan(equations, np.array([0.0, 2.0])).intervals == ((0.0, 0.25), (0.25, 0.5), (0.5, 2.0))
    assert plan(equations, np.array([0.5, 3.0])).intervals == ((0.5, 3.0),)
