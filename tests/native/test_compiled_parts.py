"""Kernels and elimination within loops agree in machine code and in plain Python."""

import copy
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp
from beamdae.native.linear_solver import LinearSolver, factorize_linear, solve_linear
from beamdae.native.loop_functions import call_kernel, combine, factorize, solve
from chains import pattern_of_elements
from numpy.testing import assert_allclose, assert_array_equal
from test_loops import compile_without_warnings

from beamdae.core.return_codes import DONE, NEW_PIVOTS, SINGULAR
from beamdae.linear.pivots import propose_plans
from beamdae.native.lane_kernels import LANE_WIDTH, build_lane_kernel
from beamdae.native.object_code import is_native_enabled

pytestmark = pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")


# Kernels.


@dataclass(slots=True)
class Kernels:
    kernels: Any
    starts: np.ndarray
    shared: np.ndarray
    local: np.ndarray
    out: np.ndarray
    values: np.ndarray
    code_owners: tuple = ()


def evaluate_all(work):
    for k in range(work.starts.shape[0]):
        start, lanes = work.starts[k, 0], work.starts[k, 1]
        call_kernel(work.kernels, k, work.shared, work.local, start, work.out, lanes)
        combine(work.values[k], (1.0,), (work.out,))
    return 0


@pytest.mark.parametrize("count", [0, 1, 2])
def test_kernels_are_called_with_their_inputs(count):
    s, x = ca.SX.sym("s", 2), ca.SX.sym("x", 3)
    functions = [
        ca.Function("first_of_test", [s, x], [ca.vertcat(s[0] * ca.sin(x), x[0] / s[1])]),
        ca.Function("second_of_test", [s, x], [ca.exp(-x[1:]) + s[1]]),
    ]
    lanes = [build_lane_kernel(function) for function in functions[:count]]
    random = np.random.default_rng(0)
    shared, local = random.normal(size=2), random.normal(size=9 * LANE_WIDTH)
    starts = np.array([(0, 2 * LANE_WIDTH), (6 * LANE_WIDTH, LANE_WIDTH)], np.int64)[:count]
    buffers = np.zeros(8 * LANE_WIDTH), np.zeros((count, 8 * LANE_WIDTH))

    def bind_kernel(kernel, start, copies):
        def call(shared, local, out):
            inputs = local[start : start + 3 * copies].reshape(3, copies)
            out[: kernel.n_out * copies] = kernel(shared, inputs).ravel()

        return call

    python_kernels = [bind_kernel(k, *start) for k, start in zip(lanes, starts, strict=True)]
    addresses = np.array([kernel.address for kernel in lanes], np.int64)
    plain = Kernels(python_kernels, starts, shared, local, *(x.copy() for x in buffers))
    compiled = Kernels(addresses, starts, shared, local.copy(), *buffers, tuple(lanes))
    evaluate_all(plain)
    compile_without_warnings(evaluate_all, compiled)()
    assert_array_equal(compiled.values, plain.values)
    assert_array_equal(compiled.local, local)
    assert np.count_nonzero(plain.values[:1]) == (0, 8, 8)[count] * LANE_WIDTH


# Elimination.


@dataclass(slots=True)
class System:
    linear: LinearSolver
    nonzeros: np.ndarray
    right: np.ndarray


def solve_system(work):
    code = factorize(work.linear, work.nonzeros)
    if code == DONE:
        solve(work.linear, work.right)
    return code


def solve_in_python(work):
    code = factorize_linear(work.linear, work.nonzeros)
    if code == DONE:
        solve_linear(work.linear, work.right)
    return code


def system(kind, size, seed, dense=None):
    """Return a matrix with a band and a border, or a given pattern, with a plan."""
    random = np.random.default_rng(seed)
    row, column = np.indices((size, size))
    if dense is None:
        dense = (np.abs(row - column) < 3) | (np.minimum(row, column) < 2)
    pattern = sp.csc_array(dense.astype(float))

    def numbers(length):
        real = random.normal(size=length)
        return real + 1j * random.normal(size=length) if kind is complex else real

    nonzeros = numbers(pattern.nnz) + 10.0 * (row == column).T[dense.T]
    linear = LinearSolver.empty(kind)
    linear.set_plan(next(propose_plans(pattern, nonzeros)))
    return System(linear, nonzeros, numbers(size)), pattern


def assert_same_system(one, other, rtol):
    for name in ("needs_pivots", "is_untried", "singular", "factorizations", "solves"):
        assert getattr(one.linear, name) == getattr(other.linear, name)
    for name in ("matrix", "blocks", "upper", "lower", "inverse", "refinements"):
        x, y = getattr(one.linear.factors, name), getattr(other.linear.factors, name)
        assert_allclose(x, y, rtol=0.0, atol=rtol * np.abs(y).max(initial=0.0))
    assert_allclose(one.right, other.right, rtol=0.0, atol=rtol * np.abs(other.right).max())


# Division of complex numbers differs.
@pytest.mark.parametrize(("kind", "rtol"), [(float, 0.0), (complex, 1e-14)])
@pytest.mark.parametrize("size", [1, 2, 12, 40])
def test_compiled_elimination_agrees(kind, rtol, size):
    plain, pattern = system(kind, size, size)
    compiled = copy.deepcopy(plain)
    loop = compile_without_warnings(solve_system, compiled)
    right = plain.right.copy()
    assert loop() == solve_in_python(plain) == DONE
    assert_same_system(compiled, plain, rtol)
    pattern = sp.csc_array((plain.nonzeros, pattern.indices, pattern.indptr))
    assert_allclose(pattern @ compiled.right, right, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("kind", "rtol"), [(float, 0.0), (complex, 1e-12)])
def test_compiled_elimination_of_blocks_agrees(kind, rtol):
    dense = pattern_of_elements(20, border=3)
    plain, pattern = system(kind, len(dense), 0, dense)
    factors = plain.linear.factors
    assert len(plain.linear.plan.batches) > 3
    compiled = copy.deepcopy(plain)
    right = plain.right.copy()
    assert compile_without_warnings(solve_system, compiled)() == solve_in_python(plain) == DONE
    # Complex numbers are stored differently.
    if kind is complex:
        factors.blocks[:] = compiled.linear.factors.blocks
    assert_same_system(compiled, plain, rtol)
    pattern = sp.csc_array((plain.nonzeros, pattern.indices, pattern.indptr))
    assert_allclose(pattern @ compiled.right, right, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", [float, complex])
@pytest.mark.parametrize("number", [0.0, np.nan, np.inf])
def test_compiled_elimination_rejects_the_same_pivots(kind, number):
    plain, _ = system(kind, 12, 0)
    plain.nonzeros[:] = number
    compiled = copy.deepcopy(plain)
    with np.errstate(all="ignore"):
        expected = solve_in_python(plain)
    assert compile_without_warnings(solve_system, compiled)() == expected == NEW_PIVOTS
    assert compiled.linear.needs_pivots == plain.linear.needs_pivots == 1
    assert compiled.linear.factorizations == compiled.linear.solves == 0


def test_missing_plan_is_requested_and_singular_matrix_is_reported():
    problem = System(LinearSolver.empty(float), np.ones(1), np.ones(1))
    assert compile_without_warnings(solve_system, problem)() == NEW_PIVOTS
    problem.linear.needs_pivots, problem.linear.singular = 0, 1
    assert compile_without_warnings(solve_system, problem)() == SINGULAR
    assert problem.linear.needs_pivots == 0
