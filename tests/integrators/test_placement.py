"""Costs and results of runs do not depend on the place and the orientation of a mechanism."""

import numpy as np
import pytest
from mechanisms import clamped_beam, rectangle
from numpy.testing import assert_allclose
from properties.similarity import Similarity

import beamdae as bd

STEEL = bd.Material(E=2e11, nu=0.3, rho=7800.0)
FAR = Similarity(0.5 * np.pi, (800.0, 600.0))
PLACES = [Similarity(0.5 * np.pi), Similarity(-0.5 * np.pi, (-30.0, 1000.0)), FAR]


def section(height):
    return rectangle(height, damping=1e-5, material=STEEL)


def driven_flexible_rod(place):
    mech = bd.Mechanism(gravity=place.way(0.0, -9.81))
    origin, crank_end, rod_end = (place.point(x, 0.0) for x in (0.0, 0.1, 0.5))
    crank = mech.add(bd.RigidBody.rod("crank", origin, crank_end, mass=1.0))
    rod = mech.add(bd.Beam("rod", bd.Line(crank_end, rod_end), section(0.008), elements=2))
    slider = mech.add(bd.PointMass("slider", 0.5, at=rod_end))
    mech.add(bd.Revolute("pivot", mech.ground.at(*origin), crank.at(*origin)))
    mech.add(bd.Revolute("crankpin", crank.at(*crank_end), rod.start))
    mech.add(bd.Revolute("wristpin", rod.end, slider.point))
    axis = place.way(1.0, 0.0)
    mech.add(bd.PointOnLine("guide", mech.ground.at(*origin), slider.point, direction=axis))
    mech.add(bd.Driver("motor", mech.ground.at(*origin), crank.at(*origin), lambda t: 20.0 * t))
    mech.observe("strain", rod.strain(s=0.2, offset=0.004))
    return mech


def lightly_loaded_cantilever(place):
    mech, beam = clamped_beam(
        section(0.02), 2, bd.Line(place.point(0.0, 0.5), place.point(1.0, 0.5))
    )
    x, y = place.way(0.0, 1e-3)
    load = (lambda t: x * np.sin(6.0 * t), lambda t: y * np.sin(6.0 * t))
    mech.add(bd.Force("load", beam.end, load))
    mech.observe("strain", beam.strain(s=0.2, offset=0.004))
    return mech


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("integrator", [bd.Radau(1e-4), bd.Ida(1e-4)], ids=["radau", "ida"])
@pytest.mark.parametrize("model", [driven_flexible_rod, lightly_loaded_cantilever])
def test_steps_and_strains_do_not_depend_on_the_placement(model, integrator, place):
    def run(place):
        return bd.simulate(model(place), integrator, t_end=0.05, output_step=0.001)

    reference, placed = run(Similarity()), run(place)
    assert_allclose(placed.trajectory.steps, reference.trajectory.steps, rtol=0.1)
    strain = reference["strain"]
    assert_allclose(placed["strain"], strain, rtol=0.0, atol=1e-3 * np.ptp(strain))


def test_radau_resolves_tight_tolerances_far_from_the_origin():
    """Rounding errors of the positions exceed the tolerances of axial deformations."""
    run = bd.simulate(
        driven_flexible_rod(FAR), bd.Radau(1e-6, max_steps=3000), t_end=0.02, output_step=0.001
    )
    assert run.status.kind == "ok"
