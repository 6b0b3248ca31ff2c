"""Matrices of all forms, with nonholonomic constraints and friction that depends on reactions."""

from __future__ import annotations

import numpy as np
import pytest
from chains import chain_of_beams
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, assert_derivative

import beamdae as bd
from beamdae.equations.formulations.first_order import (
    FIRST_ORDER,
    evaluate_jacobian,
    evaluate_jacobian_parts,
    formulate_first_order,
)
from beamdae.equations.formulations.step_equations import StepPrediction, formulate_step
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.state_evaluator import StateEvaluator

TIME = np.array([0.3, 0.4])


def _equations():
    """Return a crank with a beam, rolling disks, a skate and friction."""
    mech = bd.Mechanism(gravity=(0.3, -2.0))
    crank = mech.add(bd.RigidBody("crank", mass=1.1, inertia=0.4, center=(0.1, 0.0)))
    beam = mech.add(VARIANTS[0].beam(ARC))
    disk = mech.add(bd.RigidBody("disk", mass=0.7, inertia=0.1, center=(0.5, 0.4)))
    far = mech.add(bd.RigidBody("far", mass=0.7, inertia=0.1, center=(0.5, -0.4)))
    bearing = mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)))
    mech.add(bd.Revolute("pin", crank.at(*ARC.start), beam.start))
    slot = mech.add(bd.PointOnLine("slot", crank.at(0.5, 0.4), disk.at(0.5, 0.4), (0.3, 1.0)))
    mech.add(bd.Skate("skate", beam.at(0.7), direction=(1.0, 0.4)))
    apart = float(np.hypot(*np.subtract((0.5, 0.4), beam.end.point)))
    radii = (0.4 * apart, 0.6 * apart)
    mech.add(bd.RollingOnCircle("gear", beam.end, disk.at(0.5, 0.4), radii))
    mech.add(bd.RollingOnLine("road", mech.ground.at(0.0, -0.6), far.at(0.5, -0.4), 0.2))
    # Smooth enough for difference quotients over 1e-3.
    law = {"coefficient": 0.4, "friction_speed": 2.0, "smoothing": 0.5}
    mech.add(bd.Friction("rub", bearing, **law, radius=0.3, static=0.6, stribeck=3.0))
    mech.add(bd.Friction("slide", slot, **law))
    return bd.equations_of_motion(mech)


@pytest.fixture(scope="module")
def equations():
    return _equations()


def _full(pattern, nonzeros):
    matrix = pattern.copy()
    matrix.data = np.array(nonzeros).ravel()
    return matrix.toarray()


@pytest.mark.parametrize("form", FIRST_ORDER)
def test_jacobian_of_first_order_forms(equations, form):
    system = formulate_first_order(equations, form)
    rng = np.random.default_rng(9)
    y, yp = 0.3 * rng.standard_normal((2, system.size))
    y[: equations.n] += equations.q0
    c = 1.7

    def residual(z):
        return system.residual(TIME, z, yp + c * (z - y))

    jacobian = _full(system.pattern, system.jacobian(TIME, y, yp, c))
    assert_derivative(jacobian, residual, y)
    apart = formulate_first_order(equations, form, apart=True)
    parts = np.zeros((2, apart.pattern.nnz))
    evaluate_jacobian_parts(apart.buffers(), *TIME, y, yp, parts.ravel())
    whole = system.jacobian(TIME, y, yp, c)
    assert (system.pattern != apart.pattern).nnz == 0
    assert_allclose(parts[0] + c * parts[1], whole, rtol=1e-12, atol=1e-12)  # rounding


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("stabilized", [False, True], ids=["index3", "stabilized-index2"])
def test_jacobian_of_step_equations(equations, stabilized):
    step = formulate_step(equations, stabilized)
    rng = np.random.default_rng(10)
    x = 0.2 * rng.standard_normal(step.size)
    q_p, q_n = equations.q0 + 0.2 * rng.standard_normal((2, equations.n))
    v_p, a_p = rng.standard_normal((2, equations.n))
    at = StepPrediction(q_p, v_p, a_p, q_n, np.array([3.0, 5.0, 0.7]))
    whole = _full(step.pattern, step.jacobian(TIME, at, x))
    # The matrix has the corrections of positions, r = -G^T eta, as additional unknowns.
    x_rows, r_rows = slice(step.size), slice(step.size, None)
    jacobian = whole[x_rows, x_rows] - whole[x_rows, r_rows] @ whole[r_rows, x_rows]
    assert_derivative(jacobian, lambda z: step.residual(TIME, at, z), x)


@pytest.mark.parametrize("form", FIRST_ORDER)
def test_packed_states_solve_the_first_order_form(equations, form):
    v = np.random.default_rng(11).standard_normal(equations.n)
    state = ConsistencySolver(equations).state(TIME, equations.q0, v)
    system = formulate_first_order(equations, form)
    # Gaps are closed to 1e-12; forces are of order ten.
    assert_allclose(system.residual(TIME, *system.pack(state)), 0.0, atol=1e-9)


@pytest.mark.parametrize("level", [0, 1])
def test_consistent_start_satisfies_constraints_on_positions_and_velocities(equations, level):
    rng = np.random.default_rng(12)
    q = equations.q0 + 1e-3 * rng.standard_normal(equations.n)
    v = rng.standard_normal(equations.n)
    state = ConsistencySolver(equations).state(TIME, q, v)
    assert_allclose(
        StateEvaluator(equations).constraint_levels(TIME, *state[:3])[level], 0.0, atol=1e-11
    )


@pytest.mark.parametrize("name", FIRST_ORDER)
def test_the_parts_of_the_jacobian_add_up(name):
    equations = bd.equations_of_motion(chain_of_beams(2, elements=2))
    whole, apart = (
        formulate_first_order(equations, name),
        formulate_first_order(equations, name, apart=True),
    )
    assert (whole.pattern != apart.pattern).nnz == 0
    y, yp = np.random.default_rng(0).normal(size=(2, whole.size))
    of_y, of_yp = parts = np.zeros((2, whole.pattern.nnz))
    evaluate_jacobian_parts(apart.buffers(), 0.3, 0.5, y, yp, parts.ravel())
    expected = np.zeros(whole.pattern.nnz)
    for c in (0.0, 40.0):
        evaluate_jacobian(whole.buffers(), 0.3, 0.5, c, y, yp, expected)
        assert_allclose(of_y + c * of_yp, expected, rtol=1e-12, atol=1e-12 * abs(expected).max())
    assert np.any(of_yp != 0.0)
