"""Sums at single states have the same bits in CasADi's virtual machine and in machine code."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import hinged_beam, rectangle

import beamdae as bd
from beamdae.equations.formulations.static_equations import plan_static_sums
from beamdae.equations.starts.state_evaluator import plan_balance, plan_motion, plan_state_sums
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.sums.kernel_sums import Kernel, evaluate_sum
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

PLANS = {
    "motion": plan_motion,
    "balance": plan_balance,
    "gradients": lambda structure: plan_state_sums(structure).gradients,
    "saddle": lambda structure: plan_state_sums(structure).saddle,
    "static tangent": lambda structure: plan_static_sums(structure).tangent,
}


@pytest.fixture(scope="module")
def equations():
    """Equations of a hinged beam whose tip touches a floor."""
    section = rectangle(0.02, 0.01)
    mech, beam = hinged_beam(section, 2, (1.0, 0.2), gravity=9.81)
    mech.add(bd.Contact("tip", beam.end, bd.LineSurface(mech.ground.at(0.0, 0.25)), 1e6))
    return bd.equations_of_motion(mech)


@pytest.mark.skipif(not is_native_enabled(), reason="machine code is off")
@pytest.mark.parametrize("name", PLANS)
def test_evaluators_have_the_bits_of_machine_code(equations, name):
    plan, rng = PLANS[name](equations.structure), np.random.default_rng(1)
    x = rng.standard_normal(3 * equations.n + equations.m)
    x[: equations.n] = equations.q0 + 1e-3 * x[: equations.n]
    total, evaluator = plan.sum(True, equations.p), SumEvaluator(plan, equations.p)
    total.shared[:] = evaluator.shared[:] = rng.uniform(0.1, 1.0, plan.n_shared)
    size = 10 * len(x) ** 2  # larger than any result
    expected = np.zeros(size)
    for factor in (1.0, 2.0):
        evaluate_sum(total, factor * x, expected)
        assert np.any(expected)
        np.testing.assert_array_equal(evaluator(factor * x, size), expected)


def test_regression_many_evaluators_compile_nothing(equations, monkeypatch):
    """A run with 30 impacts compiled the sums at the states of impacts."""
    requests = []
    monkeypatch.setattr(Kernel, "load_native", lambda kernel, compiles: requests.append(compiles))
    plan = replace(plan_motion(equations.structure))
    for k in range(60):
        SumEvaluator(plan, equations.p + k)
    assert requests
    assert not any(requests)
