"""Loads along a beam: dead loads, pressure, formulas of position, moving forces."""

import numpy as np
import pytest
from mechanisms import clamped_beam, rectangle
from numpy.testing import assert_allclose
from support import ARC, NumericEquations

import beamdae as bd

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
