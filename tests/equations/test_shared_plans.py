"""Structures that differ only in the weights of operators share the plans of their sums."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import beamdae as bd
from beamdae.equations.formulations.first_order import plan_jacobian, plan_residual
from beamdae.equations.formulations.static_equations import plan_static_sums
from beamdae.equations.formulations.step_equations import plan_step_sums
from beamdae.equations.measures import plan_balance
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.symbolic.sums.kernel_sums import SumPlan

pytestmark = pytest.mark.slow(reason="kernels of beams are built: one second in all")

ARRAYS = [name for name, kind in SumPlan.__annotations__.items() if kind == "Array"]
PLANS = [
    (plan_balance, ()),
    (plan_state_sums, ()),
    (plan_static_sums, ()),
    (plan_step_sums, (True,)),
    (plan_residual, ("stabilized-index1",)),
    (plan_jacobian, ("stabilized-index1", True)),
]


def build_arch(radius):
    """Two beams welded inside an element: the weld has shape functions as weights."""
    steel = bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=0.004)
    arc = bd.Arc(radius=radius, length=0.6)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("beam", arc, section, elements=[0.0, 0.25, 0.6]))
    mech.add(bd.Weld("clamp", mech.ground.at(*beam.start.point), beam.start))
    inner = beam.at(0.4)
    mass = mech.add(bd.RigidBody("mass", 1.0, inertia=0.01, center=inner.point))
    mech.add(bd.Weld("bolts", inner, mass.at(*inner.point)))
    return bd.equations_of_motion(mech)


@pytest.fixture(scope="module")
def structures():
    with pytest.warns(bd.BeamdaeWarning, match="inside an element"):
        return build_arch(0.5).structure, build_arch(0.8).structure


def find_plans(value):
    if isinstance(value, SumPlan):
        return [value]
    entries = value if isinstance(value, tuple) else getattr(value, "__dict__", {}).values()
    return [plan for entry in entries for plan in find_plans(entry)]


def test_shared_plans_equal_those_of_each_structure(structures):
    assert structures[0] != structures[1]
    for plan, arguments in PLANS:
        for structure in structures:
            plans = find_plans(plan(structure, *arguments))
            expected = find_plans(plan.__wrapped__(structure, *arguments))
            assert len(plans) == len(expected) > 0
            for x, y in zip(plans, expected, strict=True):
                for name in ARRAYS:
                    message = f"{plan.__name__}, {name}"
                    assert_array_equal(getattr(x, name), getattr(y, name), message)


def test_plans_share_all_arrays_but_weights(structures):
    for plan, arguments in PLANS:
        for x, y in zip(*(find_plans(plan(s, *arguments)) for s in structures), strict=True):
            assert x.batch_table is y.batch_table
            assert not np.array_equal(x.gather_weights, y.gather_weights)


def test_patterns_are_shared(structures):
    one, other = (plan_state_sums(x) for x in structures)
    assert one.saddle_pattern is other.saddle_pattern
