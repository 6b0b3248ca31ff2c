"""Lookups in tables: rows, derivatives by coordinates and by numbers, and machine code."""

import casadi as ca
import numpy as np
import pytest
from mechanisms import free_ball
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.export.c_code import UnsupportedOperationError, write_kernel
from beamdae.native.lane_code import write_lane_module
from beamdae.native.lane_kernels import build_lane_kernel
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.table_lookups import (
    directional_derivative,
    find_row,
    jacobian,
    pick_numbers,
    weighted_derivative,
)

AXIS = np.array([0.0, 0.1, 0.4, 0.5, 0.6, 0.9, 1.0])
NUMBERS = np.concatenate([AXIS, np.random.default_rng(0).normal(size=2 * len(AXIS))])
# Before the table, between rows, at rows and after the table.
PLACES = (-1.0, 0.05, 0.1, 0.45, 0.95, 1.0, 2.0)

X, DATA = ca.SX.sym("x"), ca.SX.sym("data", len(NUMBERS))
AXIS_SYMBOLS, VALUES, SLOPES = ca.vertsplit(DATA, len(AXIS))


def lookup_expression():
    row = find_row(X, AXIS_SYMBOLS)
    slope = pick_numbers(row, SLOPES)
    depth = X - pick_numbers(row, AXIS_SYMBOLS)
    return ca.vertcat(pick_numbers(row, VALUES) + slope * depth, slope**2 * X)


@pytest.mark.parametrize("x", PLACES)
def test_rows_are_those_of_a_search(x):
    row = int(ca.Function("row", [X, DATA], [find_row(X, AXIS_SYMBOLS)])(x, NUMBERS))
    assert row == np.clip(np.searchsorted(AXIS, x, side="right") - 1, 0, len(AXIS) - 2)


@pytest.mark.parametrize("x", PLACES)
def test_derivatives_by_numbers_are_those_of_differences(x):
    value, direction, weights = lookup_expression(), ca.SX.sym("d", DATA.shape), ca.SX.sym("w", 2)
    forward = ca.Function(
        "f", [X, DATA, direction], [directional_derivative(value, DATA, direction)]
    )
    transposed = ca.Function("t", [X, DATA, weights], [weighted_derivative(value, DATA, weights)])
    matrix = ca.Function("j", [X, DATA], [jacobian(value, DATA)])
    rng, h = np.random.default_rng(1), 1e-6
    change, w = rng.normal(size=len(NUMBERS)), np.array([0.3, -0.7])
    # An axis that moves may pass x, which changes the row.
    change[: len(AXIS)] *= x not in AXIS
    evaluate = ca.Function("v", [X, DATA], [value])
    above, below = (evaluate(x, NUMBERS + k * h * change).full().ravel() for k in (1.0, -1.0))
    expected = (above - below) / (2.0 * h)
    assert_allclose(forward(x, NUMBERS, change).full().ravel(), expected, atol=1e-8)
    assert_allclose(matrix(x, NUMBERS).full() @ change, expected, atol=1e-8)
    assert_allclose(transposed(x, NUMBERS, w).full().ravel() @ change, w @ expected, atol=1e-8)


@pytest.mark.parametrize("transposes", [False, True])
@pytest.mark.skipif(not is_native_enabled(), reason="machine code is switched off")
def test_machine_code_of_lookups_agrees_with_the_virtual_machine(transposes):
    value, weights = lookup_expression(), ca.SX.sym("w", 2)
    result = weighted_derivative(value, DATA, weights) if transposes else value
    shared, local = ca.SX.sym("t"), ca.vertcat(X, DATA, weights)
    function = ca.Function("lookup", [shared, local], [ca.densify(result)])
    kernel = build_lane_kernel(function)
    places = np.array([*PLACES, 0.7])
    column = np.concatenate([NUMBERS, [0.3, -0.7]])[:, None]
    inputs = np.concatenate([places[None, :], np.tile(column, len(places))])
    expected = np.hstack([function(0.0, one).full() for one in inputs.T])
    np.testing.assert_array_equal(kernel(np.zeros(1), inputs), expected)


def spring_on_table(rows):
    x = np.linspace(0.0, 2.0, rows)
    mech, mass = free_ball((1.0, 0.0), 2.0, name="mass")
    law = bd.table(x, 40.0 * x, kind="linear")
    mech.add(bd.Spring("spring", mech.ground.at(0, 0), mass.point, law=law))
    return bd.equations_of_motion(mech)


def test_regression_code_does_not_grow_with_the_rows_of_a_table():
    # 19 instructions per row took 10 s to compile for 2000 rows.
    sizes = []
    for rows in (20, 200):
        plans = [plan for plan in formulate_step(spring_on_table(rows), False).sums if plan]
        kernels = [batch.kernel for plan in plans for batch in plan.batches]
        sizes.append([len(write_lane_module(kernel.function).splitlines()) for kernel in kernels])
    assert sizes[0] == sizes[1]


def test_tables_without_local_numbers_have_no_c_code():
    shared = ca.SX.sym("shared", len(AXIS))
    function = ca.Function("f", [shared, X], [find_row(X, shared)])
    with pytest.raises(UnsupportedOperationError, match="table_find"):
        write_kernel("f", function)


def test_regression_tables_in_equations_of_casadi_have_machine_code():
    """Equal numbers of a table were one number of the kernel, which lookups cannot read."""
    q, v = ca.SX.sym("q", 1), ca.SX.sym("v", 1)
    spring = bd.table([-2.0, -1.0, 0.0, 1.0, 2.0], [2.0, 1.0, 0.0, -1.0, -3.0], kind="linear")
    mass, g = ca.SX.eye(1), ca.SX(0, 1)
    system = bd.ConstrainedSystem(
        t=X, q=q, v=v, mass=mass, force=spring(q[0]), constraints=g, q0=[0.5], v0=[0.0]
    )
    run = bd.simulate(system, bd.Radau(1e-8), t_end=1.0)
    assert_allclose(run.q[-1], 0.5 * np.cos(1.0), rtol=1e-7)
    for total in formulate_step(run.equations, False).sums:
        for batch in total.batches:
            assert write_lane_module(batch.kernel.function)
