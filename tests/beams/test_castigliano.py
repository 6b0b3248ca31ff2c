"""Loads along a beam, and a quarter-circle cantilever under tip loads (Castigliano)."""

from functools import cache

import numpy as np
import pytest
from mechanisms import clamped_beam, rectangle
from numpy.testing import assert_allclose
from support import ARC, NumericEquations

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


# Loads along a beam: dead loads, pressure, formulas of position, moving forces.

STRIP = rectangle(0.01, material=bd.Material(E=2e11, nu=0.3, rho=7800.0))


@pytest.mark.parametrize(
    ("curve", "share"),
    # On the curved beam, weight and load are integrated along axes that differ by the mesh error.
    [(bd.Line((0.1, 0.2), (1.3, 1.0)), 1e-13), (ARC, 1e-3)],
)
def test_uniform_dead_load_is_the_weight(curve, share):
    gravity = np.array([1.5, -9.81])

    def numeric(weighed):
        mech = bd.Mechanism(gravity=tuple(gravity) if weighed else (0.0, 0.0))
        beam = mech.add(bd.Beam("beam", curve, STRIP, elements=6))
        if not weighed:
            mech.add(bd.DistributedForce("weight", beam, tuple(STRIP.rhoA * gravity)))
        return NumericEquations(mech)

    weighed, loaded = numeric(True), numeric(False)
    rng = np.random.default_rng(0)
    q = weighed.equations.q0 + 0.05 * rng.standard_normal(weighed.n)
    expected = weighed.force(q)
    still = NumericEquations(free(curve)).force(q)
    scale = np.max(np.abs(expected - still))
    assert_allclose(
        loaded.force(q), expected, rtol=0.0, atol=share * scale + 1e-15 * abs(still).max()
    )


def free(curve):
    mech = bd.Mechanism()
    mech.add(bd.Beam("beam", curve, STRIP, elements=6))
    return mech


def test_resultant_of_pressure_on_a_ring_and_on_an_arch():
    def resultant(angle):
        mech = bd.Mechanism()
        arc = bd.Arc(radius=0.4, length=0.4 * angle, start=(0.3, 0.1), angle=0.2)
        beam = mech.add(bd.Beam("beam", arc, STRIP, elements=12, frame="tangent"))
        mech.add(bd.DistributedForce("pressure", beam, (0.0, 700.0), axes="section"))
        x, y = arc.point(arc.length) - np.asarray(arc.point(0.0))
        return -NumericEquations(mech).force()[:2], 700.0 * np.array([-y, x])

    force, _ = resultant(2.0 * np.pi)
    assert_allclose(force, 0.0, atol=1e-9)
    force, expected = resultant(2.0)
    assert_allclose(force, expected, rtol=1e-6)  # mesh error


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_load_by_a_sensor_on_all_elements(formulation):
    mech, beam = clamped_beam(STRIP, 3, ARC, gravity=9.81, formulation=formulation)
    height = mech.sensor("height", beam.end, "y")
    load = mech.add(bd.DistributedForce("load", beam, (0.0, 10.0 * height)))
    for name, quantity in {"sum": load.force, "end": beam.end}.items():
        mech.observe(name, quantity)
    mech.observe("root", beam.section_forces(0.0))
    path = bd.equilibrium(mech, step=1.0)
    sum_of_load, y = path["sum.Fy"].iloc[-1], path["end.y"].iloc[-1]
    # Lengths of elements, which interpolate the arc, have errors of 5e-6.
    assert_allclose(sum_of_load, 10.0 * y * ARC.length, rtol=1e-4)
    # The section at the clamp carries the load and the weight.
    forces, weight = path.section_forces(beam, 0.0), STRIP.rhoA * 9.81 * ARC.length
    total = np.hypot(forces.N[0, 0], forces.Q[0, 0])
    assert_allclose(total, abs(sum_of_load - weight), rtol=1e-4)


def test_elastic_foundation_by_a_formula_of_position():
    """Compare force and moment on a rigidly displaced beam with the exact integrals."""
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (2.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, STRIP, elements=3, frame="tangent"))
    mech.add(bd.DistributedForce("bed", beam, lambda s, x, y, t: (0.0, -50.0 * y * (1.0 + s))))
    numeric = NumericEquations(mech)
    q = numeric.equations.q0.copy()
    q[1], q[2] = 0.1, 0.3
    height = [0.1, np.sin(0.3)]
    # Integrals of y (1 + s) and of its moment about the start, y = 0.1 + s sin(0.3).
    force = 50.0 * (height[0] * 4.0 + height[1] * (2.0 + 8.0 / 3.0))
    moment = 50.0 * np.cos(0.3) * (height[0] * (2.0 + 8.0 / 3.0) + height[1] * (8.0 / 3.0 + 4.0))
    assert_allclose(numeric.force(q)[:3], [0.0, force, moment], rtol=1e-12, atol=1e-10)


BUMP = bd.table([0.0, 0.53, 0.56, 0.59, 1.0], [0.0, 0.0, 1e3, 0.0, 0.0], kind="linear")


@pytest.mark.parametrize("elements", [5, 8, [0.0, 0.2, 0.4, *np.linspace(0.53, 0.59, 9), 0.8, 1.0]])
def test_errors_of_loads_that_change_within_elements_are_stated(elements):
    mech, beam = clamped_beam(STRIP, elements)
    mech.add(bd.DistributedForce("bump", beam, lambda s, x, y, t: (0.0, -1e-3 * BUMP(s))))
    mech.observe("tip", beam.end)
    path = bd.equilibrium(mech)
    # A force of 0.03 N at 0.56 m.
    expected = -0.03 * 0.56**2 * (3.0 - 0.56) / (6.0 * STRIP.EI)
    error = abs(path["tip.y"].iloc[-1] / expected - 1.0)
    stated = path.errors.table()["total"]["tip.y [m]"]
    # Statements end at 100 %.
    assert 0.5 * error - 1e-3 < min(stated, 1.0) < 2.0 * error + 1e-3


def test_moving_force_acts_on_the_beam_only():
    mech = free(bd.Line((0.0, 0.0), (1.0, 0.0)))
    mech.add(bd.MovingForce("load", mech.part("beam"), (3.0, -2.0), speed=2.0, start=-1.0))
    for t, acting in ((0.25, 0.0), (0.5, 1.0), (0.7, 1.0), (1.0, 1.0), (1.3, 0.0)):
        # Where two pieces of a law meet, the later piece applies.
        numeric = NumericEquations(mech, time=(t, t - 1e-9 if t == 1.0 else t))
        assert_allclose(-numeric.force()[:2], acting * np.array([3.0, -2.0]), atol=1e-12)
        # Moment about the start of the beam.
        assert_allclose(-numeric.force()[2], acting * -2.0 * (2.0 * t - 1.0), atol=1e-12)
