"""Compare a quarter-circle cantilever under tip loads with Castigliano's theorem.

The arc is clamped at (R, 0) and has its tip at (0, R). Displacements are small: u_r, u_t and the
rotation of the tip under radial, tangential and moment loads, including axial and shear
flexibility. The table lists relative errors measured with 8 curved elements in a tangent frame, in
the directions of the three loads:

    R/h     3 points (the default)          4 points
    4        6.8e-7  -1.3e-8   2.3e-7        3.1e-7  -1.2e-7  -1.1e-7
    20       6.9e-7  -2.4e-8   2.3e-7       -6.0e-6  -2.1e-6  -7.0e-6
    100      6.9e-7  -2.5e-8   2.3e-7       -3.2e-5  -3.9e-5  -1.1e-4
    500      6.7e-7  -4.0e-8   2.2e-7       -2.6e-4  -6.3e-4  -1.7e-3
    2500    -1.0e-7  -8.5e-7  -2.9e-7       -6.6e-4  -1.7e-3  -4.4e-3

With three points, elements do not lock (at R/h = 2500, rounding errors of the linear system are
1e-6). With four points, elements lock: the error of the moment load increases by a factor of 4e4.
With "local" continuity, the errors of the force loads are 6.2e-4 and 8.1e-4 at every R/h; with
straight elements, the errors of the three loads are 8.0e-3, 2.3e-3 and 1.6e-3.

Relative errors for the moment load with fewer nodes per element:

    R/h     2 nodes, 1 point    2 points    3 nodes, 2 points    3 points
    4            -1.6e-3         -1.7e-1         -5.2e-7         -3.9e-4
    20           -1.6e-3         -8.3e-1         -5.2e-7         -8.7e-3
    100          -1.6e-3         -9.9e-1         -5.2e-7         -1.2e-1
    500          -1.6e-3           -1.0          -5.1e-7         -4.8e-1
    2500         -1.6e-3           -1.0          -6.7e-7         -9.5e-1
"""

from functools import cache

import numpy as np
import pytest
from mechanisms import rectangle
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd

RADIUS = 2.0
SLENDERNESS = (4, 20, 100, 500, 2500)


def exact_compliance(section):
    """Return tip displacements (u_r, u_t, rotation), one column per unit load (P_r, P_t, M)."""
    R, EI, EA, GA = RADIUS, section.EI, section.EA, section.GA
    stretch = np.pi * R / 4.0 * (1.0 / EA + 1.0 / GA)
    rr = np.pi * R**3 / (4.0 * EI) + stretch
    rt = -(R**3) / (2.0 * EI) + R / 2.0 * (1.0 / EA - 1.0 / GA)
    tt = R**3 / EI * (3.0 * np.pi / 4.0 - 2.0) + stretch
    rm, tm, mm = -(R**2) / EI, R**2 / EI * (np.pi / 2.0 - 1.0), np.pi * R / (2.0 * EI)
    return np.array([[rr, rt, rm], [rt, tt, tm], [rm, tm, mm]])


def square(slenderness):
    """Return a square section of the height R / slenderness."""
    height = RADIUS / slenderness
    steel = bd.Material(E=2.1e11, nu=0.3, rho=7800.0)
    return rectangle(height, height, material=steel)


@cache
def errors(
    slenderness,
    elements,
    quadrature="reduced",
    shape="curved",
    frame="tangent",
    strain="linear",
    continuity="cartesian",
    nodes=4,
):
    """Return the relative errors of the compliance matrix, shape (3, 3)."""
    section = square(slenderness)
    geometry = (elements, shape, frame, continuity, nodes)
    beam = _quarter(section, *geometry, quadrature=quadrature, strain=strain)
    mech = bd.Mechanism()
    mech.add(beam)
    mech.add(bd.Weld("clamp", mech.ground.at(RADIUS, 0.0), beam.start))
    clamped = NumericEquations(mech)
    loads = _loads(*geometry)
    stiffness, joint = clamped.stiffness(), clamped.constraint_matrix()
    saddle = np.block([[stiffness, joint.T], [joint, np.zeros((clamped.m, clamped.m))]])
    # Stiffnesses span ten decades at R/h = 2500; scaling keeps eight digits of the solution.
    diagonal = np.sqrt(np.abs(np.diag(saddle)))
    scale = np.where(diagonal > 0.0, diagonal, 1.0)
    right = np.concatenate([loads, np.zeros((clamped.m, 3))])
    balanced = np.linalg.solve(saddle / np.outer(scale, scale), right / scale[:, None])
    compliance = loads.T @ (balanced / scale[:, None])[: clamped.n]
    return compliance / exact_compliance(section) - 1.0


def _quarter(section, elements, shape, frame, continuity, nodes, **settings):
    quarter = bd.Arc(
        radius=RADIUS, length=0.5 * np.pi * RADIUS, start=(RADIUS, 0.0), angle=0.5 * np.pi
    )
    return bd.Beam(
        "beam",
        quarter,
        section,
        elements=elements,
        nodes=nodes,
        elements_shape=shape,
        continuity=continuity,
        frame=frame,
        **settings,
    )


@cache
def _loads(*geometry):
    """Return the generalized forces of the unit loads, one column per load."""
    beam = _quarter(square(4), *geometry)
    return np.stack(
        [
            _generalized(beam, load)
            for load in (
                bd.Force("radial", beam.end, (0.0, 1.0)),
                bd.Force("tangential", beam.end, (-1.0, 0.0)),
                bd.Moment("moment", beam.end, 1.0),
            )
        ],
        axis=1,
    )


def _generalized(beam, load):
    mech = bd.Mechanism()
    mech.add(beam)
    mech.add(load)
    return -NumericEquations(mech).force()


def in_load_directions(*case, **words):
    return np.abs(np.diag(errors(*case, **words)))


@pytest.mark.parametrize(
    ("frame", "strain"),
    [
        ("tangent", "nonlinear"),
        ("chord", "linear"),
        pytest.param("tangent", "linear", marks=pytest.mark.slow(reason="several runs")),
        pytest.param("chord", "nonlinear", marks=pytest.mark.slow(reason="several runs")),
    ],
)
@pytest.mark.parametrize(
    ("nodes", "shape", "continuity", "max_error"),
    [
        (4, "curved", "cartesian", 2e-6),
        # 8.1e-4 in the tangent frame, 4.2e-4 in the chord frame.
        (4, "curved", "local", 1e-3),
        (4, "straight", "cartesian", 9e-3),
        # 1.4e-5 in the tangent frame, 3.1e-5 in the chord frame.
        (3, "curved", "cartesian", 4e-5),
        # 1.10e-2 at R/h = 4, and 1.12e-2 at all other R/h.
        (2, "straight", "cartesian", 1.2e-2),
    ],
)
def test_default_quadrature_does_not_lock(nodes, shape, continuity, max_error, frame, strain):
    case = {"nodes": nodes, "shape": shape, "continuity": continuity}
    worst = [np.abs(errors(r, 8, frame=frame, strain=strain, **case)).max() for r in SLENDERNESS]
    assert max(worst) < max_error
    # Errors hardly depend on R/h; 1e-6 are rounding errors of the most slender arc.
    assert max(worst) < 1.05 * worst[0] + 1e-6


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("shape", ["curved", "straight"])
def test_straight_elements_do_not_lock_with_four_points_and_curved_ones_do(shape):
    thick, thin = (errors(r, 8, quadrature="full", shape=shape)[2, 2] for r in (4, 2500))
    if shape == "straight":
        assert abs(thin) < 1.01 * abs(thick)
    else:
        assert abs(thick) < 1e-6
        # Membrane locking makes the arc too stiff by 0.4 %.
        assert -5e-3 < thin < -4e-3


@pytest.mark.slow(reason="a fifth of a second")
def test_curved_elements_converge_with_fourth_order():
    # Measured with 1, 2, 4, 8 elements: radial 2.2e-3, 1.7e-4, 1.1e-5, 6.9e-7; tangential 6.4e-3,
    # 8.5e-5, 7.4e-7, 2.4e-8; moment 8.6e-4, 5.7e-5, 3.6e-6, 2.3e-7.
    error = np.array([in_load_directions(20, n) for n in (1, 2, 4, 8)])
    orders = np.log2(error[:-1] / error[1:])
    assert np.all(orders > 3.6)
    assert np.all(orders[1:] > 3.85)


@pytest.mark.slow(reason="a fifth of a second")
def test_quadratic_elements_converge_with_fourth_order():
    # The compliance is an energy, whose order is twice that of the strains: 2 (nodes - 1). Measured
    # with 4, 8, 16 elements: radial 8.9e-5, 5.6e-6, 3.5e-7; tangential 9.3e-5, 6.4e-6, 4.1e-7;
    # moment 8.2e-6, 5.2e-7, 3.2e-8. Rounding errors are up to 2e-9 from 32 elements on.
    error = np.array([in_load_directions(20, n, nodes=3) for n in (4, 8, 16)])
    assert_allclose(np.log2(error[:-1] / error[1:]), 4.0, atol=0.15)


@pytest.mark.slow(reason="seven meshes of two elements or one")
def test_elements_of_high_degree_converge_exponentially():
    # Measured with 5 to 9 nodes in one element: tangential 1.9e-4, 3.8e-6, 4.0e-8, 3.4e-10, 2.6e-11
    # (rounding); the errors under the other loads are smaller.
    error = np.array([in_load_directions(20, 1, nodes=n) for n in range(5, 10)])
    assert np.all(error.argmax(axis=1)[:4] == 1)
    assert np.all(error[1:4, 1] < 0.03 * error[:3, 1])
    assert np.all(error[3:] < 1e-9)
    # 1.1e-8, 6.6e-7 and 7.1e-10 with half as long elements: the ratio is 2^8 to 2^9.
    assert np.all(in_load_directions(20, 2, nodes=5) < error[0] / 100.0)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("slenderness", [20, 500])
def test_local_continuity_converges_with_second_order(slenderness):
    # Measured with 1, 2, 4, 8, 16 elements: radial 2.2e-3, 5.2e-3, 2.1e-3, 6.2e-4, 1.7e-4;
    # tangential 6.4e-3, 5.2e-3, 2.5e-3, 8.1e-4, 2.3e-4; the last orders are 1.9 and 1.8. The
    # neglected kinks do not affect the rotation under a moment.
    error = np.array([in_load_directions(slenderness, n, continuity="local") for n in (4, 8, 16)])
    orders = np.log2(error[:-1] / error[1:])[:, :2]
    assert np.all((orders > 1.6) & (orders < 2.0))
    assert np.all(orders[1] > orders[0])
    assert error[1, 2] < 1e-6


@pytest.mark.parametrize(
    ("nodes", "quadrature"),
    [
        (2, "reduced"),
        (3, "reduced"),
        (4, "reduced"),
        pytest.param(4, "full", marks=pytest.mark.slow(reason="several runs")),
    ],
)
def test_straight_elements_converge_with_second_order(nodes, quadrature):
    # Radial errors with 2, 4, 8 elements: 1.2e-1, 3.2e-2, 8.0e-3, due to the distance of the
    # polygon from the arc; with 2 nodes, bending adds an error of second order: 1.7e-1, 4.4e-2,
    # 1.1e-2.
    case = {"nodes": nodes, "quadrature": quadrature, "shape": "straight"}
    error = np.array([in_load_directions(20, n, **case) for n in (4, 8, 16)])
    assert_allclose(np.log2(error[:-1] / error[1:]), 2.0, atol=0.15)


@pytest.mark.parametrize("nodes", [2, 3, 4])
@pytest.mark.parametrize("shape", ["curved", "straight"])
def test_compliance_is_symmetric(shape, nodes):
    # Maxwell's theorem: the errors above and below the diagonal agree except for rounding.
    for r in (4, 100):
        error = errors(r, 8, shape=shape, nodes=nodes)
        assert_allclose(error, error.T, atol=1e-8)
