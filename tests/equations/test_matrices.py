"""Matrices of all forms, energies of rows, and models that differ only in numbers."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hub_beam import hub_beam
from mechanisms import G, swing
from numpy.testing import assert_allclose
from slider_crank import slider_crank
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


# Energies of the rows of a run.


def test_regression_rates_of_states_are_no_forces():
    """Rates of states counted as forces: they caused false warnings, or hid residuals of bodies."""
    mech = bd.Mechanism()
    x, y = (mech.state(name, start=2.0) for name in "xy")
    x.follows(y)
    y.follows(10.0 * (1.0 - x * x) * y - x)
    assert bd.simulate(mech, bd.Radau(), t_end=5.0).warnings == ()


@pytest.mark.parametrize("method", [bd.GeneralizedAlpha(0.01), bd.Radau(1e-8), bd.Ida(1e-8)])
def test_energies_do_not_depend_on_the_other_rows(method):
    """Rows at steps, between them and at breakpoints have the energies of their states."""
    mech = swing()
    mech.add(bd.Force("push", mech.part("bob").at(1.0, 0.0), (bd.piecewise((0.05, 3.0), 0.0), 0)))
    few, many = (bd.simulate(mech, method, 0.4, output_step=x) for x in (0.1, 0.005))
    for name, values in few.energies.items():
        assert_allclose(values, many.energies[name][::20], rtol=1e-9, atol=1e-9)
    kinetic = 2.0 * (few.v[:, :2] ** 2).sum(axis=1) / 2.0 + 0.1 * few.v[:, 2] ** 2 / 2.0
    # Energies between steps are interpolated.
    assert_allclose(few.energies["energy.kinetic [J]"], kinetic, rtol=1e-7, atol=1e-14)
    gravity = few.energies["energy.gravity [J]"].to_numpy()
    assert_allclose(gravity - gravity[0], 2.0 * G * few.q[:, 1], rtol=1e-7, atol=1e-12)


# Models that differ only in numbers are independent of each other, also in threads.

# Fixed steps, adaptive steps, and both integrators of first-order forms.
METHODS = [
    bd.GeneralizedAlpha(step=2e-3),
    bd.GeneralizedAlpha(rtol=1e-3),
    bd.Ida(rtol=1e-3),
    bd.Radau(rtol=1e-3),
]


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
    return np.hstack([columns, solution.q, solution.v, solution.lam])


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("method", METHODS, ids=lambda method: repr(method)[:24])
def test_no_number_of_one_model_leaks_into_another(method):
    first = rows(method, 0)
    other = rows(method, 1)
    assert not np.array_equal(other, first)
    assert np.array_equal(rows(method, 0), first)
    assert np.array_equal(rows(method, 1), other)


@pytest.mark.slow(reason="many rounds of threads")
@pytest.mark.parametrize("method", METHODS, ids=lambda method: repr(method)[:24])
def test_threads_that_share_a_structure_are_independent(method):
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
