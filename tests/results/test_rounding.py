"""Results far from the origin, and limits by rounding."""

import warnings
from typing import Any

import numpy as np
import pytest
from mechanisms import EARTH, free_ball, rectangle

import beamdae as bd

HEIGHT = 4.0


def falling_device(
    gravity: float = 9.81, guided: bool = True, modulus: float = 22e9, **options: object
) -> bd.Mechanism:
    """Return a box with an elastic board, high above a floor that it does not reach."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    box = mech.add(bd.RigidBody.plate("box", (0.7, HEIGHT), 0.12, 0.04, mass=0.25))
    if guided:
        ground = mech.ground.at(0.7, HEIGHT)
        mech.add(bd.Prismatic("guide", ground, box.at(0.7, HEIGHT), direction=(0.0, 1.0)))
    laminate = bd.Material(E=modulus, nu=0.15, rho=1850.0)
    section = rectangle(1.6e-3, 0.03, damping=2e-5, material=laminate)
    line = bd.Line((0.67, HEIGHT), (0.73, HEIGHT))
    board = mech.add(bd.Beam("board", line, section, elements=4, **options))
    screws = mech.add(bd.Weld("screws", box.at(0.67, HEIGHT), board.start))
    mech.add(bd.PointMass("battery", 0.015, on=board.end))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    bumper = box.at(0.7, HEIGHT - 0.02)
    mech.add(bd.Contact("bumper", bumper, floor, 2e6, restitution=0.5, impact_speed=8.0))
    mech.observe("box", bd.acceleration(box.at(0.7, HEIGHT)))
    mech.observe("clamp", board.stress(0.0, "top"))
    mech.observe("gauge", board.strain(0.005, "top"))
    mech.observe("largest", board.largest_stress())
    mech.observe("screws", screws.reaction_on("b"))
    mech.observe("middle", board.section_forces(0.03))
    return mech


FALLS = {
    "frame": {"strain": "exact"},
    "exact": {"formulation": "exact"},
    "exact, free": {"formulation": "exact", "guided": False},
    "frame, free": {"guided": False},
    "stiff": {"formulation": "exact", "guided": False, "modulus": 22e12},
}


ROUNDING_INTEGRATORS = {"auto": None, "ida": bd.Ida(), "fixed": bd.GeneralizedAlpha(1e-3)}


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("output_step", [0.05, 5e-3])
@pytest.mark.parametrize("integrator", ROUNDING_INTEGRATORS.values(), ids=ROUNDING_INTEGRATORS)
@pytest.mark.parametrize("options", FALLS.values(), ids=FALLS)
def test_regression_free_fall_has_no_warnings_about_rounding_errors(
    options: dict[str, Any], integrator: object, output_step: float
) -> None:
    """Stresses of 1e-10 Pa had warnings of fast vibrations, long steps, rows and mesh errors."""
    mech = falling_device(**options)
    arguments = {} if integrator is None else {"integrator": integrator}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = bd.simulate(mech, t_end=0.7, output_step=output_step, **arguments)
    stiffness_ratio = options.get("modulus", 22e9) / 22e9
    assert np.max(np.abs(run.columns["clamp [Pa]"])) < 0.1 * stiffness_ratio


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("force", [1e-3, 1.0])
def test_vibrations_by_small_sudden_loads_have_warnings(force: float) -> None:
    mech = falling_device(strain="exact")
    mech.add(bd.Force("hit", mech.parts["board"].end, (0.0, -force)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = bd.simulate(mech, bd.Radau(), t_end=0.05, output_step=5e-3)
    assert any("fast vibrations" in x or "output rows" in x for x in run.warnings)


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
