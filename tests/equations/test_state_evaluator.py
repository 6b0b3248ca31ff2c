"""Evaluation of forces, constraints and matrices at single states."""

import gc
from copy import copy

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import beamdae as bd
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.symbolic.sums.kernel_sums import evaluate_sum, set_time

TIME = np.zeros(2)


def build_pendulum(mass):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.PointMass("bob", mass, at=(1.0, 0.0)))
    mech.add(bd.Distance("rope", mech.ground.at(0.0, 0.0), bob.point))
    return bd.equations_of_motion(mech)


def force_by_new_sum(equations, q):
    evaluator = StateEvaluator(equations)
    total = evaluator.sums.motion.sum(False, equations.p)
    set_time(total, *TIME)
    result = np.zeros(equations.n + 3 * equations.m)
    evaluate_sum(total, np.concatenate([q, np.zeros(2 * equations.n + equations.m)]), result)
    return result[: equations.n]


@pytest.mark.slow(reason="a fifth of a second")
def test_models_that_differ_in_numbers_reuse_sums_one_after_the_other():
    light, heavy = build_pendulum(0.2), build_pendulum(3.0)
    q, rest = light.q0 + 0.1, np.zeros(light.n)
    gc.collect()
    first, second = StateEvaluator(light), StateEvaluator(heavy)
    for _ in range(2):
        assert_array_equal(first.force(TIME, q, rest), force_by_new_sum(light, q))
        assert_array_equal(second.force(TIME, q, rest), force_by_new_sum(heavy, q))
    used = first._motion._buffers
    assert used is not second._motion._buffers
    del first
    third = StateEvaluator(heavy)
    assert_array_equal(third.force(TIME, q, rest), force_by_new_sum(heavy, q))
    assert third._motion._buffers is used


def test_regression_copies_have_their_own_sums():
    """The sum of a copy was reused by other instances after the original had been deleted."""
    equations = build_pendulum(0.2)
    evaluator = StateEvaluator(equations)
    q, rest = equations.q0 + 0.1, np.zeros(equations.n)
    evaluator.force(TIME, q, rest)
    other = copy(evaluator)
    assert_array_equal(other.force(TIME, q, rest), force_by_new_sum(equations, q))
    assert other._motion._buffers is not evaluator._motion._buffers


def test_repeated_gaps_at_a_position_are_evaluated_once(monkeypatch):
    evaluations = []
    evaluate = StateEvaluator._evaluate

    def count(*arguments):
        evaluations.append(arguments)
        return evaluate(*arguments)

    monkeypatch.setattr(StateEvaluator, "_evaluate", count)
    evaluator, q = StateEvaluator(build_pendulum(0.2)), np.array([3.0, 4.0])
    assert_array_equal(evaluator.position_gaps(TIME, q), evaluator.position_gaps(TIME, q.copy()))
    assert len(evaluations) == 1
    gaps = evaluator.position_gaps(TIME, q)
    # An array that changes in place is a new position.
    q += 1.0
    assert evaluator.position_gaps(TIME, q) != gaps
    assert len(evaluations) == 2
