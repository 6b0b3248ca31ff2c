"""Matrices of all forms, with nonholonomic constraints and friction that depends on reactions."""

import numpy as np
import pytest
from support import ARC, VARIANTS, assert_derivative

import beamdae as bd
from beamdae.equations.formulations.first_order import (
    FIRST_ORDER,
    formulate_first_order,
)
from beamdae.equations.formulations.step_equations import StepPrediction, formulate_step

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
