"""Errors and warnings do not depend on the origin of the drawing."""

import numpy as np
import pytest
from mechanisms import EARTH, free_ball, rectangle

import beamdae as bd

STEEL = bd.Material(E=2e11, nu=0.3, rho=7800.0)
SECTION = rectangle(0.02, damping=1e-5, material=STEEL)
FAR = (100.0, -70.0)
INTEGRATORS = {"radau": bd.Radau(1e-3), "alpha": bd.GeneralizedAlpha(step=5e-3)}


def small_vibration(x, y, start="as drawn", gravity=(0.0, 0.0)):
    """Cantilever with a load of 1 mN, whose tip moves by 1e-7 m."""
    mech = bd.Mechanism(gravity=gravity, start=start)
    line = bd.Line((x, y), (x + 1.0, y))
    beam = mech.add(bd.Beam("beam", line, SECTION, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(x, y), beam.start))
    mech.add(bd.Force("load", beam.end, (0.0, bd.sine(1e-3, 3.0))))
    mech.observe("tip", beam.end)
    mech.observe("root", beam.start)
    mech.observe("middle", beam.deflection(0.5))
    return mech


def steady_deflection(x, y):
    """Cantilever in equilibrium under its own weight."""
    return small_vibration(x, y, "equilibrium", (0.0, -9.81))


def crank(x, y, torque=None):
    """Crank that drives a slider, at 20 rad/s or by a torque [N m]."""
    mech = bd.Mechanism(gravity=EARTH)
    arm = mech.add(bd.RigidBody.rod("crank", (x, y), (x + 0.1, y), mass=1.0))
    rod = mech.add(bd.RigidBody.rod("rod", (x + 0.1, y), (x + 0.5, y), mass=1.0))
    slider = mech.add(bd.PointMass("slider", 0.5, at=(x + 0.5, y)))
    pivot = mech.ground.at(x, y)
    mech.add(bd.Revolute("main", pivot, arm.at(x, y)))
    mech.add(bd.Revolute("crank pin", arm.at(x + 0.1, y), rod.at(x + 0.1, y)))
    mech.add(bd.Revolute("wrist pin", rod.at(x + 0.5, y), slider.point))
    mech.add(bd.PointOnLine("guide", pivot, slider.point, direction=(1.0, 0.0)))
    if torque is None:
        mech.add(bd.Driver("motor", pivot, arm.at(x, y), lambda t: 20.0 * t))
    else:
        mech.add(bd.Moment("motor", arm.at(x, y), torque))
    mech.observe("slider", slider.point)
    mech.observe("pivot", arm.at(x, y))
    return mech


MODELS = [small_vibration, steady_deflection, crank]


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("model", MODELS)
def test_errors_and_warnings_do_not_depend_on_the_origin(model, name):
    runs = [
        bd.simulate(model(*place), INTEGRATORS[name], t_end=0.3, output_step=0.003)
        for place in ((0.0, 0.0), FAR)
    ]
    near, far = (run.errors.table() for run in runs)
    # Rounding errors of positions at 100 m leave a few digits of motions of 1e-7 m.
    np.testing.assert_allclose(near["total"], far["total"], rtol=0.3, atol=1e-3)
    assert len(runs[0].warnings) == len(runs[1].warnings)


@pytest.mark.parametrize("place", [(0.0, 0.0), FAR])
def test_regression_fixed_points_have_no_errors(place):
    """Pivots that moved by the drift of 4e-7 m with fixed steps had errors of 230 %."""
    solution = bd.simulate(
        crank(*place), bd.GeneralizedAlpha(step=5e-3), t_end=0.3, output_step=0.003
    )
    errors = solution.errors.table()["total"]
    pivot = ["pivot.x [m]", "pivot.y [m]", "pivot.x_dot [m/s]", "pivot.y_dot [m/s]"]
    assert (errors[pivot] == 0.0).all()
    assert errors["slider.x_dot [m/s]"] > 0.0


@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_regression_vibrations_far_from_the_origin_need_rows(offset):
    """At 100 m, vibrations of less than 0.1 mm were taken for errors."""
    mech, mass = free_ball((offset + 1e-5, 0.0), name="mass")
    wall = mech.ground.at(offset - 1.0, 0.0)
    mech.add(bd.Spring("spring", wall, mass.point, (2.0 * np.pi * 77.0) ** 2, 0.0, 1.0))
    method = bd.GeneralizedAlpha(step=2e-4)
    (sentence,) = bd.simulate(mech, method, t_end=1.0, output_step=5e-3).row_warnings
    assert sentence.startswith("mass.x")
