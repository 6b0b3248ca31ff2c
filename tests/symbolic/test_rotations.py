"""Batched sums with rotated kernels agree with sums over single copies."""

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from mechanisms import hinged_beam, rectangle
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.equations.equations_of_motion import State
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.equations.formulations.sums import term_data
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.sums.kernel_sums import evaluate_sum, set_matrix_factors, set_time

TIME = np.array([0.1, 0.5])
# Rounding errors of sums over 100 elements.
RTOL = 1e-12


def arch(elements, **settings):
    alloy = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
    section = rectangle(0.0025, 0.03, damping=1e-4, material=alloy)
    curve = bd.Arc(radius=0.85, length=0.80, start=(0.0, 0.0), angle=-0.60)
    mech, beam = hinged_beam(section, elements, curve, gravity=9.81, **settings)
    mech.add(bd.PointMass("tip mass", 0.060, on=beam.end))
    return bd.equations_of_motion(mech)


def motion(equations, random):
    q = equations.q0 + 1e-3 * random.normal(size=equations.n)
    v, a = random.normal(size=(2, equations.n))
    return State(q, v, a, np.zeros(equations.m))


@pytest.mark.parametrize("native", [False, True])
@pytest.mark.parametrize("settings", [{}, {"frame": "tangent", "elements_shape": "straight"}])
def test_batched_sums_agree_with_sums_over_copies(native, settings):
    """Copies of 8 and more elements are moved in tiles."""
    if native and not is_native_enabled():
        pytest.skip("without machine code")
    for elements in (1, 21):
        compare_with_sums_over_copies(native, elements, settings)


def compare_with_sums_over_copies(native, elements, settings):
    equations = arch(elements, **settings)
    state = motion(equations, np.random.default_rng(elements))
    form = formulate_step(equations, False)
    c_v, c_a, n = 30.0, 200.0, equations.n
    inputs = np.concatenate([*state, state.q, state.lam])
    totals = [plan.sum(native, equations.p) for plan in form.sums[::2]]
    set_matrix_factors(totals[1], 1.0, c_v, c_a, 1.0, 1.0, 1.0)
    results = np.zeros(form.size), np.zeros(form.pattern.nnz)
    for total, values in zip(totals, results, strict=True):
        set_time(total, *TIME)
        evaluate_sum(total, inputs, values)
    pattern, (result, nonzeros) = form.pattern, results
    matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
    force, tangent = sum_over_copies(equations, state, (1.0, c_v, c_a))
    dynamic_block = matrix[:n, :n].toarray()
    assert_allclose(result[:n], force, rtol=0.0, atol=RTOL * np.abs(force).max())
    assert_allclose(dynamic_block, tangent, rtol=0.0, atol=RTOL * np.abs(tangent).max())


def sum_over_copies(equations, state, c):
    """Return F and its derivatives times c, summed over one copy after the other."""
    n = equations.n
    force, tangent = np.zeros(n), np.zeros((n, n))
    for term in equations.forces:
        kernel = term.kernel
        selections = term.operator.toarray().reshape(term.count, -1, n)
        rotations = equations.p[term.data].reshape((-1, term.count), order="F")
        operators = [
            rotation_matrix(term.rotation, numbers) @ selection if term.rotation else selection
            for selection, numbers in zip(
                selections, rotations[kernel.local.n_data :].T, strict=True
            )
        ]
        x, vectors = kernel.local, (kernel.local.q, kernel.local.v, kernel.local.a)
        parts = [
            factor * ca.jacobian(kernel.force, y) for factor, y in zip(c, vectors, strict=True)
        ]
        outputs = [ca.densify(kernel.force), ca.densify(sum(parts))]
        function = ca.Function("copy", [x.time, *vectors, x.data], outputs)
        data = term_data(equations, term).T
        for operator, numbers in zip(operators, data, strict=True):
            column, matrix = function(TIME, *(operator @ y for y in state[:3]), numbers)
            force += operator.T @ column.full().ravel()
            tangent += operator.T @ matrix.full() @ operator
    return force, tangent


def rotation_matrix(rotation, numbers):
    return ca.DM(rotation.matrix(ca.SX(ca.DM(numbers)))).full()


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("name", ["stabilized-index1", "index1", "index3"])
def test_separate_matrices_add_up(name):
    equations = arch(75)
    random = np.random.default_rng(0)
    y, yp = formulate_first_order(equations, name).pack(motion(equations, random))
    together, apart = (formulate_first_order(equations, name, apart) for apart in (False, True))
    stiffness, inertia = np.split(apart.jacobian(TIME, y, yp), 2)
    for c in (0.0, 1.0, 1e3):
        expected = stiffness + c * inertia
        assert_allclose(
            together.jacobian(TIME, y, yp, c),
            expected,
            rtol=0.0,
            atol=1e-13 * np.abs(expected).max(),
        )
