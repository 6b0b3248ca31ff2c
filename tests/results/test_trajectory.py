"""Dense output between the steps of a run."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

from beamdae.equations.equations_of_motion import State
from beamdae.integrators.radau.coefficients import C
from beamdae.results.trajectory import Interval, Trajectory

STEPS = np.array([0.0, 0.1, 0.15, 0.4, 0.9, 1.0])
# Three nodes per step, as for Radau IIA.
STAGES = np.append((STEPS[:-1, None] + np.append(0.0, C[:-1]) * np.diff(STEPS)[:, None]).ravel(), 1)
BETWEEN = np.linspace(0.0, 1.0, 137)


def make_interval(nodes, functions, branch=0.5, nodes_per_step=1):
    """Return an interval of functions q, v, a and lam of time."""
    rows = State(*(np.stack([f(nodes)], axis=-1) for f in functions))
    return Interval(nodes, rows, branch, nodes_per_step)


def polynomial(degree, seed=0):
    return Polynomial(np.random.default_rng(seed).normal(size=degree + 1))


def largest_errors(state, functions, t):
    """Return the largest error of each of q, v, a and lam."""
    return np.array([np.max(np.abs(x[:, 0] - f(t))) for x, f in zip(state, functions, strict=True)])


@pytest.mark.parametrize(("nodes_per_step", "orders"), [(1, [5, 5, 4, 4]), (3, [5, 4, 4, 4])])
def test_orders_of_the_dense_output(nodes_per_step, orders):
    functions = np.sin, np.cos, lambda t: -np.sin(t), np.sin
    at = np.linspace(0.0, 4.0, 1001)
    errors = []
    for steps in (32, 64):
        ends = np.linspace(0.0, 4.0, steps + 1)
        inside = np.append(0.0, C[:-1])[:nodes_per_step]
        nodes = np.append((ends[:-1, None] + inside * (ends[1] - ends[0])).ravel(), 4.0)
        errors.append(
            largest_errors(
                make_interval(nodes, functions, nodes_per_step=nodes_per_step).at(at), functions, at
            )
        )
    assert_allclose(np.log2(np.divide(*errors)), orders, rtol=0.0, atol=0.2)


@pytest.mark.parametrize("nodes_per_step", [1, 3])
def test_regression_vibrations_too_fast_for_the_steps_are_not_amplified(nodes_per_step):
    """Interpolating h v and h^2 a of an axial vibration gave 4500 N between steps with 0.1 N."""
    nodes = np.linspace(0.0, 1.0, 31)
    signs = np.resize([1.0, -1.0, -1.0, 1.0, 1.0], 31)[:, None]
    amplitude, rate = 1e-9, 1e6
    rows = State(*(amplitude * rate**k * signs for k in (0, 1, 2)), signs)
    state = Interval(nodes, rows, 0.5, nodes_per_step).at(BETWEEN)
    if nodes_per_step == 1:
        # The Lebesgue constant of a polynomial of degree 4 over its last step is 2.2.
        assert np.max(np.abs(state.q)) < 2.3 * amplitude
    assert np.max(np.abs(state.v)) < 2.3 * amplitude * rate


@pytest.mark.parametrize(("nodes", "nodes_per_step"), [(STEPS, 1), (STAGES, 3)])
def test_regression_a_jump_at_the_start_does_not_cause_oscillations(nodes, nodes_per_step):
    """Reactions overshot in the steps after a start or breakpoint where sections are damped."""
    values = np.linspace(1.0, 2.0, len(nodes))[:, None]
    values[0] = -1e3
    state = Interval(nodes, State(values, values, values, values), 0.5, nodes_per_step).at(BETWEEN)
    count = np.searchsorted(BETWEEN, nodes[1], side="right")
    for x in (state.a, state.lam):
        assert (np.diff(x[:count, 0]) > 0.0).all()
        # With uneven nodes, linear values by index are not exactly a line.
        assert x[count:].min() > 0.9
        assert x[count:].max() < 2.1


def test_a_trajectory_evaluates_each_time_in_its_interval():
    rising, falling = Polynomial([0.0, 1.0]), Polynomial([2.0, -1.0])
    still = Polynomial([0.0])
    t = np.linspace(0.0, 1.0, 5)
    first = make_interval(t, (rising, rising.deriv(), still, still), branch=0.5)
    # The reaction jumps at t = 1.
    second = make_interval(t + 1.0, (falling, falling.deriv(), still, still + 7.0), branch=1.5)
    times = np.array([0.0, 0.5, 1.0, 1.25, 2.0])
    rows, state = Trajectory((first, second)).at(times)
    assert_allclose(rows[:, 0], times, rtol=0.0, atol=0.0)
    # A breakpoint belongs to the interval that it ends.
    assert_allclose(rows[:, 1], [0.5, 0.5, 0.5, 1.5, 1.5], rtol=0.0, atol=0.0)
    assert_allclose(state.q[:, 0], [0.0, 0.5, 1.0, 0.75, 0.0], rtol=0.0, atol=1e-14)
    assert_allclose(state.lam[:, 0], [0.0, 0.0, 0.0, 7.0, 7.0], rtol=0.0, atol=1e-14)
    assert Trajectory((first, second)).end == 2.0


@pytest.mark.parametrize("nodes_per_step", [1, 3])
@pytest.mark.parametrize("steps", [1, 2, 5])
def test_polynomials_do_not_cross_jumps(nodes_per_step, steps):
    """At a sample of a controller, a step of length zero leads to the state after the jump."""
    fractions = C if nodes_per_step == 3 else [1.0]
    degree = min(steps, 3) if nodes_per_step == 1 else 3
    pieces = [[polynomial(degree, 4 * k + j) for j in range(4)] for k in range(3)]
    nodes, rows, starts = [], [], np.arange(3.0)
    for k, start in enumerate(starts):
        ends = np.linspace(0.0, 1.0, steps + 1)
        inner = [a + c * (b - a) for a, b in pairwise(ends) for c in fractions]
        t = start + np.concatenate([np.zeros(nodes_per_step if k else 1), inner])
        nodes.append(t)
        rows.append(np.stack([f(t) for f in pieces[k]]))
    q, v, a, lam = np.concatenate(rows, axis=1)[..., None]
    interval = Interval(np.concatenate(nodes), State(q, v, a, lam), 0.5, nodes_per_step)
    assert interval.step_count == 3 * steps
    for k, start in enumerate(starts):
        t = start + np.linspace(0.01, 1.0, 33)
        state = interval.at(t)
        for x, f in zip(state[1:], pieces[k][1:], strict=True):
            assert_allclose(x[:, 0], f(t), atol=1e-10)
        assert_allclose(interval.derivative_at(t).v[:, 0], pieces[k][1].deriv()(t), atol=1e-9)
        inside = start + (np.arange(steps) + 0.4) / steps
        after, before = (interval.at(inside + x).q for x in (1e-6, -1e-6))
        assert_allclose(interval.derivative_at(inside).q, (after - before) / 2e-6, atol=1e-7)
    # A state at the time of a jump is that before the jump.
    assert interval.at(np.array([1.0])).a[0, 0] == pytest.approx(pieces[0][2](1.0))
    works = interval.integrate_to_steps(interval.rows.a)
    integrals = [f[2].integ() for f in pieces]
    total = sum(f(k + 1.0) - f(float(k)) for k, f in enumerate(integrals))
    assert works[-1, 0] == pytest.approx(total)
    half = interval.integrate_to(np.array([1.5]), interval.rows.a, works)[0, 0]
    first, second = integrals[:2]
    assert half == pytest.approx(first(1.0) - first(0.0) + second(1.5) - second(1.0))


@pytest.mark.parametrize("nodes_per_step", [1, 3])
@pytest.mark.parametrize("width", [1e-6, 0.01, 0.03, 0.1])
def test_regression_jumps_within_steps_do_not_overshoot(nodes_per_step, width):
    """Polynomials through a reaction that jumped within a step exceeded it by up to 30 %."""

    def step(t):
        return np.tanh((t - 0.5) / width)

    ends = np.linspace(0.0, 1.0, 11) + 0.03
    nodes = ends
    if nodes_per_step == 3:
        nodes = np.append((ends[:-1, None] + np.append(0.0, C[:-1]) * 0.1).ravel(), ends[-1])
    t = np.linspace(nodes[0], nodes[-1], 2001)
    state = make_interval(nodes, (np.sin, np.sin, step, step), nodes_per_step=nodes_per_step).at(
        t, limited=True
    )
    for values in (state.a, state.lam):
        assert np.max(np.abs(values)) < 1.01
    assert_allclose(state.v[:, 0], np.sin(t), rtol=0.0, atol=1e-5)
