"""Costs and results of runs depend neither on the unit of length nor on place and orientation."""

import numpy as np
import pytest
from mechanisms import clamped_beam, hinged_body, rectangle
from numpy.testing import assert_allclose
from properties.similarity import Similarity

import beamdae as bd

SCALES = [1e-5, 1e-3, 1e3]


def resonator(scale):
    """Return two beams with a mass between them, enlarged by `scale`, and its period [s].

    Without changes of the material, times grow in proportion to lengths.
    """
    silicon, half, period = bd.Material(E=160e9, nu=0.22, rho=2330.0), 0.2 * scale, 0.05 * scale
    strip = rectangle(0.002 * scale, 0.01 * scale, damping=2e-5 * scale, material=silicon)
    mech, left = clamped_beam(strip, 2, bd.Line((-half, 0.0), (0.0, 0.0)), name="left")
    right = mech.add(bd.Beam("right", bd.Line((0.0, 0.0), (half, 0.0)), strip, elements=2))
    mech.add(bd.Weld("right clamp", mech.ground.at(half, 0.0), right.end))
    mech.add(bd.Weld("middle", left.end, right.start))
    mech.add(bd.PointMass("shuttle", 0.2 * scale**3, on=left.end))
    force = bd.sine(0.2 * scale**2, 1.0 / period)
    mech.add(bd.Force("comb", left.end, (0.0, force)))
    mech.observe("middle", left.end)
    return mech, period


def run_resonator(integrator, scale):
    mech, period = resonator(scale)
    solution = bd.simulate(mech, integrator, 3.0 * period)
    assert solution.status.success, solution.status.sentence
    return solution, np.abs(solution["middle.y"]).max() / scale


@pytest.mark.parametrize(
    ("integrator", "step_tolerance"),
    [
        # Rounding errors accept and reject single steps of few.
        (bd.Radau(1e-5), 0.03),
        (bd.Radau(1e-8), 0.03),
        # BDF changes its order at single steps, after which steps differ by a tenth.
        (bd.Ida(1e-5), 0.15),
        (bd.Ida(1e-8), 0.15),
        (bd.GeneralizedAlpha(rtol=1e-5), 0.03),
    ],
    ids=str,
)
@pytest.mark.parametrize("scale", SCALES)
def test_steps_do_not_depend_on_the_unit_of_length(scale, integrator, step_tolerance):
    expected, expected_deflection = run_resonator(integrator, 1.0)
    solution, deflection = run_resonator(integrator, scale)
    steps = solution.statistics.steps
    assert_allclose(steps, expected.statistics.steps, rtol=step_tolerance)
    assert_allclose(deflection, expected_deflection, rtol=10.0 * integrator.rtol)


def lever(scale):
    mech, _ = hinged_body(scale**3, 0.1 * scale**5, (0.5 * scale, 0.0), name="bar")
    return mech


@pytest.mark.parametrize("scale", [1e-5, 1e-3, 1.0, 1e3])
def test_joints_reject_starts_that_are_off_by_a_millionth_of_the_length(scale):
    """Absolute tolerances let micro-mechanisms rotate about a center beside their hinge."""
    bar = lever(scale)
    with pytest.raises(bd.BeamdaeError, match="does not allow a rotation"):
        bd.simulate(bar, t_end=1.0, start=bd.rotation(1.0, (1e-6 * scale, 0.0)))
    start = {"bar.x": 0.3 * scale, "bar.y": 0.4 * (1.0 + 1e-6) * scale}
    with pytest.raises(bd.BeamdaeError, match="joints cannot be closed"):
        bd.simulate(bar, t_end=1.0, start=start)


@pytest.mark.parametrize("scale", [1e-5, 1e-3, 1.0, 1e3])
def test_redundant_links_must_agree_to_a_millionth_of_the_length(scale):
    mech = bd.Mechanism(redundant="minimum norm")
    bar = mech.add(bd.RigidBody("bar", scale**3, 0.1 * scale**5, center=(0.5 * scale, scale)))
    longer = (1.0 + 1e-6) * scale
    for name, x, length in (("a", 0.0, None), ("b", 0.5, None), ("c", 1.0, lambda t: longer)):
        foot, head = mech.ground.at(x * scale, 0.0), bar.at(x * scale, scale)
        mech.add(bd.Distance(name, foot, head, length))
    with pytest.raises(bd.BeamdaeError, match="none of these constraints is redundant"):
        bd.simulate(mech, t_end=0.01)


# Costs and results of runs do not depend on the place and the orientation of a mechanism.

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
