"""Warnings about drivers whose laws make velocities jump."""

import numpy as np
import pytest
from mechanisms import clamped_beam, hinged_body, rectangle

import beamdae as bd

TIMES, ANGLES = [0.0, 0.4, 0.8, 1.2], [0.0, 0.4, -0.2, 0.2]


def crank(law, joint=bd.Driver):
    mech, body = hinged_body(1.0, 0.1, (1.0, 0.0), gravity=9.81)
    if joint is bd.Distance:
        mech.add(bd.Distance("drive", mech.ground.at(2.0, 0.5), body.at(1.0, 0.5), law))
    else:
        mech.add(joint("drive", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0), law))
    mech.observe("drive", mech.part("drive").drive)
    return mech


@pytest.mark.parametrize("integrator", [bd.Ida(), bd.Radau(), bd.GeneralizedAlpha(step=0.01)])
def test_regression_a_driver_whose_slope_jumps_has_a_warning(integrator):
    """The torque at the rows was that of gravity alone, and nothing told of the impulses."""
    law = bd.table(TIMES, ANGLES, kind="linear")
    solution = bd.simulate(crank(law), integrator, t_end=1.2)
    assert solution["drive.M"].abs().max() < 9.82
    (warning,) = (x for x in solution.warnings if "slope of its law" in x)
    assert warning.startswith("drive: the slope of its law jumps 2 times, first at t = 0.4 s")


@pytest.mark.slow(reason="a fifth of a second")
def test_a_distance_whose_slope_jumps_has_a_warning():
    law = bd.piecewise((0.5, lambda t: 1.0 + 0.1 * t), 1.05)
    warnings = bd.simulate(crank(law, bd.Distance), t_end=1.0).warnings
    assert (
        sum(x.startswith("drive: the slope of its law jumps at t = 0.5 s") for x in warnings) == 1
    )


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("integrator", [bd.Auto(), bd.GeneralizedAlpha(step=0.01)])
@pytest.mark.parametrize(
    "law",
    [
        bd.run_up(3.0, 1.0),
        bd.table(TIMES, ANGLES),
        bd.table(TIMES, ANGLES, kind="pchip"),
        bd.piecewise((1.0, lambda t: t**2), lambda t: 2.0 * t - 1.0),
        bd.piecewise((0.5, lambda t: 1e-3 * np.sin(t)), lambda t: 1e-3 * np.sin(t)),
        bd.piecewise((0.2, 0.0), (0.7, lambda t: 0.1 - 0.1 * np.cos(4.0 * np.pi * (t - 0.2))), 0.0),
    ],
    ids=["run up", "spline", "pchip", "smooth pieces", "small", "bump"],
)
def test_continuous_slopes_have_no_warning(law, integrator):
    assert not any("slope" in x for x in bd.simulate(crank(law), integrator, t_end=1.2).warnings)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("kind", ["linear", "spline"])
def test_regression_angles_that_a_driver_holds_have_no_jumps(kind):
    """Velocities of 1e-17 rad/s at the rows of the force table were jumps of the constant law."""
    steel = bd.Material(E=210e9, nu=0.3, rho=7850.0)
    section = rectangle(0.008, 0.05, damping=2e-5, material=steel)
    mech, leaf = clamped_beam(section, 2, 0.4, name="leaf", formulation="exact")
    tip = mech.add(bd.RigidBody("tip", 0.5, 1e-3, center=(0.4, 0.0)))
    mech.add(bd.Weld("bolt", leaf.end, tip.at(0.4, 0.0)))
    mech.add(bd.Driver("guide", mech.ground.at(0.4, 0.0), tip.at(0.4, 0.0), law=0.0))
    force = bd.table(np.linspace(0.0, 0.01, 5), [0.0, -400.0, -600.0, -400.0, 0.0], kind)
    mech.add(bd.Force("pulse", leaf.end, (0.0, force)))
    mech.observe("tip", leaf.end)
    run = bd.simulate(mech, bd.GeneralizedAlpha(step=1e-4), t_end=0.02)
    assert not any("slope" in x for x in run.warnings)
