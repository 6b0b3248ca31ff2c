"""Runs do not depend on the unit of length."""

import numpy as np
import pytest
from mechanisms import clamped_beam, hinged_body, rectangle
from numpy.testing import assert_allclose

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
