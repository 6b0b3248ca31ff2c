"""Energy balance at rows of states, in machine code and in plain Python."""

from dataclasses import replace

import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_allclose, assert_array_equal

import beamdae as bd
from beamdae.equations import measures
from beamdae.simulation import as_equations


@pytest.fixture(scope="module")
def balance():
    """Return the balance of a hub beam, Python buffers, and more states than fit into a block."""
    equations = as_equations("simulate", hub_beam(elements=2))
    evaluate = measures.balance_rows(equations)
    run = measures.plan_balance(equations.structure).buffers(False, equations.p)
    count = 2 * len(run.times) + 3
    random = np.random.default_rng(0)
    sizes = (equations.n, equations.n, equations.n, equations.m)
    state = [random.normal(size=(count, size)) for size in sizes]
    state[0] = equations.q0 + 1e-3 * state[0]
    t = np.linspace(0.0, 1.0, count)
    return evaluate, run, np.column_stack([t, np.full(count, 0.5)]), state


def test_rows_do_not_depend_on_neighboring_rows(balance):
    evaluate, _, times, state = balance
    together = evaluate(times, *state)
    selected_rows = [0, 1, len(times) // 2, len(times) - 1]
    alone = [evaluate(times[k : k + 1], *(x[k : k + 1] for x in state))[0] for k in selected_rows]
    assert_array_equal(together[selected_rows], alone)
    assert len(np.unique(together[:, 0])) == len(times)


def test_buffers_are_reused_with_the_numbers_of_the_next_run(balance):
    evaluate, _, times, state = balance
    equations = as_equations("simulate", hub_beam(elements=2))
    plan, p = measures.plan_balance(equations.structure), equations.p
    expected = evaluate(times, *state)
    other = plan.rows(1.5 * p)
    assert not np.array_equal(other(times, *state), expected)
    buffers = other._run
    assert buffers is not evaluate._run
    del other
    again = plan.rows(p)
    assert again._run is buffers
    assert_array_equal(again(times, *state), expected)


def test_machine_code_and_plain_python_agree(balance):
    evaluate, run, times, state = balance
    run.n_rows = count = 7
    run.times[:count] = times[:count]
    run.states[:count] = np.hstack(state)[:count]
    measures.evaluate_balance(run)
    compiled = evaluate(times[:count], *(x[:count] for x in state))
    # Sums of tens of numbers in the same order in each row.
    difference = np.abs(compiled - run.results[:count]).max(axis=0)
    assert (difference <= 1e-14 * np.abs(compiled).max(axis=0)).all()


@pytest.mark.parametrize("method", [bd.GeneralizedAlpha(0.01), bd.Radau()])
def test_energies_and_drift_at_steps_are_those_that_the_run_evaluated(method):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0)))
    mech.add(bd.Distance("rod", mech.ground.at(0.0, 0.0), ball.point, 1.0))
    mech.add(bd.Force("push", ball.point, (bd.piecewise((0.05, 3.0), 0.0), 0.0)))
    solution = bd.simulate(mech, method, t_end=0.1, output_step=0.02)
    ledger, times = solution._energy_ledger, solution.trajectory.intervals[-1].t[1:]
    assert len(solution.trajectory.intervals) == 2
    # One time between the steps makes the ledger interpolate at all times.
    between = np.sort(np.append(times, 0.5 * (times[0] + times[1])))
    is_step = np.isin(between, times)
    assert_allclose(ledger.at(times), ledger.at(between)[is_step], rtol=1e-12, atol=1e-14)
    evaluate = measures.balance_rows(solution.equations)
    points, states = solution.trajectory.at(times)
    expected = evaluate(points, *states)[:, -2:]
    drift = np.stack([*replace(solution, t=times).drift_columns.values()], axis=1)
    assert_allclose(drift, expected, rtol=1e-12, atol=1e-18)


def test_regression_rates_of_states_are_no_forces():
    """Rates of states counted as forces: they caused false warnings, or hid residuals of bodies."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 2.0, at=(0.0, 0.0)))
    mech.add(bd.Force("push", ball.point, (3.0, 0.0)))
    mech.state("pressure", lambda pressure, t: 1e6 - pressure, unit="Pa")
    equations = as_equations("simulate", mech)
    at_rest = [np.zeros((1, size)) for size in (3, 3, 3, 0)]
    residual, _, static, *_ = measures.balance_rows(equations)(np.zeros((1, 2)), *at_rest)[0, 6:]
    assert (residual, static) == (3.0, 3.0)

    oscillator = bd.Mechanism()
    x, y = (oscillator.state(name, start=2.0) for name in "xy")
    x.follows(y)
    y.follows(10.0 * (1.0 - x * x) * y - x)
    assert bd.simulate(oscillator, bd.Radau(), t_end=5.0).warnings == ()
