"""Models that differ only in numbers share their structure and derived objects, not numbers."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from hub_beam import hub_beam
from slider_crank import slider_crank

import beamdae as bd
from beamdae.equations import measures, structure
from beamdae.equations.formulations.first_order import FIRST_ORDER, formulate_first_order
from beamdae.equations.formulations.kinematic_reduction import reduce_kinematics
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.equations.starts.state_evaluator import plan_state_sums
from beamdae.linear import pivots
from beamdae.symbolic.sums.sum_builder import SumBuilder

# Fixed steps, adaptive steps, and both integrators of first-order forms.
METHODS = [
    bd.GeneralizedAlpha(step=2e-3),
    bd.GeneralizedAlpha(rtol=1e-3),
    bd.Ida(rtol=1e-3),
    bd.Radau(rtol=1e-3),
]


@pytest.fixture
def empty_caches():
    """Clear the caches of earlier models."""
    for cached in (
        structure._intern_equal,
        pivots._cached_analyze_pattern,
        pivots._cached_order_pattern,
    ):
        cached.cache_clear()


def equations(**numbers):
    return bd.equations_of_motion(hub_beam(elements=2, **numbers))


@pytest.mark.parametrize(
    "numbers",
    [
        {"torque": 3.0},
        {"frequency": 2.0},
        {"density": 1000.0},
        {"length": 4.0},
        {"subtended": 50.0},
    ],
    ids=lambda numbers: next(iter(numbers)),
)
def test_models_that_differ_only_in_numbers_share_their_structure(numbers):
    one, other = equations(), equations(**numbers)
    assert other.structure is one.structure
    assert not np.array_equal(other.p, one.p)
    for sums in (
        lambda e: formulate_step(e, True).sums,
        lambda e: formulate_step(e, False).sums,
        lambda e: formulate_first_order(e, "stabilized-index1").sums,
    ):
        for x, y in zip(sums(one), sums(other), strict=True):
            assert x is y
    assert plan_state_sums(other.structure) is plan_state_sums(one.structure)
    assert reduced_jacobian(other) is reduced_jacobian(one)
    # Observables of one kind share their function.
    functions = [[o.function for o in e.observables] for e in (one, other)]
    assert all(x is y for x, y in zip(*functions, strict=True))


def reduced_jacobian(e):
    form = formulate_first_order(e, "stabilized-index1", apart=True)
    return reduce_kinematics(form)[1]


def test_reduced_equations_of_other_weights_share_their_layout(empty_caches):
    """The reduction is derived from another plan, whose weights must not be lost."""
    one = equations(bodies=2, frame="chord")
    first = reduced_jacobian(one)
    other = equations(bodies=2, frame="chord", subtended=50.0)
    assert other.structure is not one.structure
    second = reduced_jacobian(other)
    assert second._layouts is first._layouts
    structure._intern_equal.cache_clear()
    fresh = equations(bodies=2, frame="chord", subtended=50.0)
    assert fresh.structure is not other.structure
    alone = reduced_jacobian(fresh)
    for x, y in zip(vars(second).values(), vars(alone).values(), strict=True):
        if isinstance(x, np.ndarray):
            assert np.array_equal(x, y)
    assert not np.array_equal(second.weights, first.weights)


def test_radau_shares_the_tangent_kernels_of_single_states():
    """Deriving the kernels twice took a tenth of the set-up of a run."""
    e = equations()
    jacobian = formulate_first_order(e, "stabilized-index1", apart=True).sums[1]

    def tangents(total):
        return {id(x.kernel) for x in total.batches if x.kernel.function.name() == "tangent"}

    assert tangents(plan_state_sums(e.structure).saddle) == tangents(jacobian) != set()


def test_joints_at_other_points_share_their_structure():
    def pendulum(x, length):
        mech = bd.Mechanism(gravity=(0.0, -9.81))
        bob = mech.add(bd.RigidBody("bob", 1.0, 0.1, center=(x + length, 0.0)))
        mech.add(bd.Revolute("hinge", mech.ground.at(x, 0.0), bob.at(x, 0.0)))
        mech.observe("bob", bob.at(x + length, 0.0))
        return bd.equations_of_motion(mech)

    assert pendulum(0.3, 0.7).structure is pendulum(0.4, 0.9).structure


@pytest.mark.parametrize(
    "other",
    [{"elements": 3}, {"bodies": 2}, {"damping": 1e-4}, {"strain": "linear"}],
    ids=lambda numbers: next(iter(numbers)),
)
def test_other_meshes_kernels_and_operators_have_other_structures(other):
    assert bd.equations_of_motion(hub_beam(**{"elements": 2, **other})).structure is not (
        equations().structure
    )


def test_other_connections_of_bodies_have_another_structure():
    def chain(order):
        mech = bd.Mechanism()
        links = [mech.add(bd.RigidBody(f"link {k}", 1.0, 0.1, center=(k, 0.0))) for k in range(3)]
        for k, (i, j) in enumerate(order):
            mech.add(bd.Revolute(f"pin {k}", links[i].at(k, 1.0), links[j].at(k, 1.0)))
        return bd.equations_of_motion(mech).structure

    assert chain([(0, 1), (1, 2)]) is chain([(0, 1), (1, 2)])
    assert chain([(0, 1), (1, 2)]) is not chain([(0, 1), (0, 2)])


@pytest.mark.slow(reason="half a second")
def test_the_total_size_of_cached_structures_is_limited(empty_caches, monkeypatch):
    first = equations().structure
    assert equations().structure is first
    others = [bd.equations_of_motion(hub_beam(elements=k)).structure for k in range(250, 255)]
    assert max(x.n for x in others) < structure._MAX_COORDINATES
    assert sum(map(structure._count_entries, others)) > structure._MAX_CACHED_ENTRIES
    assert equations().structure is not first
    first = equations().structure
    monkeypatch.setattr(structure, "_MAX_COORDINATES", first.n - 1)
    assert equations().structure is not first


@pytest.mark.slow(reason="half a second")
def test_regression_equilibria_of_fine_meshes_plan_their_sums_once(empty_caches, monkeypatch):
    """The structures of one model displaced each other in the cache: 36 ms instead of 22 ms."""

    def cantilever():
        mech = bd.Mechanism()
        section = bd.Section.rectangle(bd.Material(E=2e11, nu=0.3, rho=7800.0), 0.02, 0.01)
        line = bd.Line((0.0, 0.0), (1.0, 0.0))
        beam = mech.add(bd.Beam("beam", line, section, 256, formulation="exact"))
        mech.add(bd.Weld("weld", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.Moment("moment", beam.end, 10.0))
        return mech

    first = bd.equilibrium(cantilever(), step=1.0)
    plans, plan = [], SumBuilder._plan
    monkeypatch.setattr(SumBuilder, "_plan", lambda *args: plans.append(args) or plan(*args))
    second = bd.equilibrium(cantilever(), step=1.0)
    assert second.q.shape[1] > 2300
    assert plans == []
    # Interpreted and compiled kernels, which replace them when they are ready, round differently.
    np.testing.assert_allclose(second.q, first.q, rtol=0.0, atol=1e-13)


def rows(method, case):
    """Return all results of a run; cases are two structures with two sets of numbers each."""
    model, scale = divmod(case, 2)
    if model:
        mechanism, t_end = slider_crank(elements=2, speed=2.0 + scale), 0.05
    else:
        mechanism, t_end = hub_beam(elements=2, torque=5.0 * (1.0 + scale)), 0.2
    solution = bd.simulate(mechanism, method, t_end)
    assert solution.status.success, solution.status.sentence
    columns = np.column_stack(list(solution.all_columns().values()))
    ranges = [(x.deflection, x.rotation, x.strain, x.error) for x in solution.validity]
    checks = np.tile(np.ravel(np.array(ranges, float)), (len(columns), 1))
    return np.hstack([columns, solution.q, solution.v, solution.lam, checks])


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("method", METHODS, ids=lambda method: repr(method)[:24])
def test_no_number_of_one_model_leaks_into_another(method, empty_caches):
    first = rows(method, 0)
    other = rows(method, 1)
    assert not np.array_equal(other, first)
    assert np.array_equal(rows(method, 0), first)
    assert np.array_equal(rows(method, 1), other)


@pytest.mark.slow(reason="many rounds of threads")
@pytest.mark.parametrize("method", METHODS, ids=lambda method: repr(method)[:24])
def test_threads_that_share_a_structure_are_independent(method, empty_caches):
    cases = [0, 1, 2, 3] * 2
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda case: rows(method, case), cases))
    expected = [rows(method, case) for case in range(4)]
    # Without machine code, rounding in LAPACK and NumPy depends on the alignment of arrays, which
    # differs between threads: about 1e-7, against differences of order 1 between cases.
    tolerance = 1e-4 if os.environ.get("BEAMDAE_NATIVE") == "off" else 0.0
    for case, actual in zip(cases, results, strict=True):
        size = np.max(np.abs(expected[case]))
        assert np.all(np.abs(actual - expected[case]) <= tolerance * size)


def falling():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.add(bd.PointMass("bob", 1.0, at=(0.0, 0.0)))
    return bd.equations_of_motion(mech)


@pytest.mark.parametrize(
    "build",
    [
        *(lambda e, form=form: formulate_first_order(e, form) for form in FIRST_ORDER),
        lambda e: formulate_step(e, True),
        lambda e: formulate_step(e, False),
        measures.plan_balance,
    ],
)
def test_derived_objects_are_built_once_for_each_equations(build):
    equations = falling()
    derived = build(equations)
    assert build(equations) is derived
    assert build(falling()) is not derived


def test_forms_are_cached_separately():
    equations = falling()
    assert len({id(formulate_first_order(equations, form)) for form in FIRST_ORDER}) == len(
        FIRST_ORDER
    )
    assert formulate_step(equations, True) is not formulate_step(equations, False)


def test_models_that_differ_only_in_numbers_share_their_operators():
    one, other = equations(), equations(density=1000.0)
    for a, b in zip(one.observables, other.observables, strict=True):
        assert a.operator is b.operator
        assert not a.operator.data.flags.writeable


def test_operators_that_a_part_can_change_are_read_at_each_assembly():
    """Cached operators would hide changes in place."""

    class Block(bd.PointMass):
        def forces(self, gravity):
            (statement,) = super().forces(gravity)
            (piece,) = statement.pieces
            return [replace(statement, pieces=(piece._replace(operator=operator),))]

    mech, operator = bd.Mechanism(), sp.csr_array(np.eye(2))
    mech.add(Block("block", 1.0, at=(0.0, 0.0)))
    before = bd.equations_of_motion(mech).structure.forces[0].operator.toarray()
    operator.data[:] = 2.0
    after = bd.equations_of_motion(mech).structure.forces[0]
    rotated = after.operator if after.rotation is None else after.operator * 2.0
    assert np.array_equal(rotated.toarray(), 2.0 * before)
