"""Sums at single states: machine code has the same bits, and is used only if it pays off."""

import numpy as np
import pytest

import beamdae as bd
from beamdae.equations.formulations.static_equations import StaticEquations
from beamdae.equations.starts.state_evaluator import StateEvaluator, plan_motion
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.functions import row_kernels
from beamdae.symbolic.sums.kernel_sums import SumPlan
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator, compile_sums

TIME = np.array([0.1, 0.1])


@pytest.fixture
def loops(monkeypatch):
    """Sums with kernels in machine code, used from the first evaluation in a study on."""
    compiled, plan_sum = [], SumPlan.sum

    def record(plan, native, p):
        compiled.extend([plan] if native else [])
        return plan_sum(plan, native, p)

    monkeypatch.setattr(row_kernels, "_OPERATIONS_BEFORE_COMPILING", 0.0)
    monkeypatch.setattr(SumPlan, "sum", record)
    return compiled


def build_equations(elements, stiffness=1e6):
    """Return the equations of a hinged beam whose tip touches a floor.

    Mechanisms with other numbers of elements do not share their plans.
    """
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.01, 0.02)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.2)), section, elements=elements))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Contact("tip", beam.end, bd.LineSurface(mech.ground.at(0.0, 0.25)), stiffness))
    return bd.equations_of_motion(mech)


def evaluate(equations):
    """Return results of all sums at one state, each of them evaluated twice."""
    rng = np.random.default_rng(1)
    q = equations.q0 + 1e-3 * rng.standard_normal(equations.n)
    v, a = rng.standard_normal((2, equations.n))
    lam = rng.standard_normal(equations.m)
    states, static = StateEvaluator(equations), StaticEquations(equations, TIME)
    results = []
    for factor in (1.0, 2.0):
        results += [
            states.force(TIME, q, factor * v, a, lam),
            states.constraint_levels(TIME, factor * q),
            states.gradients(TIME, factor * q),
            states.saddle_matrix(TIME, q, v, a, (0.3, factor, 1.0), lam),
            states.evaluate_force_change(TIME, q, factor * v, 1e-3),
            static.residual(q, factor * lam),
            static.tangent(q, factor * lam),
        ]
    return results


def test_results_have_the_bits_of_the_virtual_machine(loops):
    equations = build_equations(2)
    expected = evaluate(equations)
    assert loops == []  # outside studies
    with compile_sums():
        results = evaluate(equations)
    assert len(loops) == 7 * is_native_enabled()
    for result, other in zip(results, expected, strict=True):
        np.testing.assert_array_equal(result, other)


def test_evaluators_are_reused_with_the_numbers_of_the_next_model(loops):
    expected = evaluate(build_equations(3, 2e6))
    with compile_sums():
        assert not np.array_equal(evaluate(build_equations(3))[0], expected[0])
        count = len(loops)
        results = evaluate(build_equations(3, 2e6))
    assert len(loops) == count
    for result, other in zip(results, expected, strict=True):
        np.testing.assert_array_equal(result, other)


def test_evaluators_are_reused_with_other_sizes():
    """Models that share a plan may have more numbers, by which forces are differentiated."""
    equations = build_equations(4)
    plan = plan_motion(equations.structure)
    x = np.concatenate([equations.q0, np.zeros(2 * equations.n + equations.m)])
    size = equations.n + 3 * equations.m
    results = []
    for more in (0, 5):

        class Owner:
            pass

        owner = Owner()
        results.append(SumEvaluator.borrow(plan, equations.p, owner)(x, size + more))
        del owner
    np.testing.assert_array_equal(results[1], np.append(results[0], np.zeros(5)))
