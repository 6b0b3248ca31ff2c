"""Warnings of runs in which strains, stresses, forces or accelerations are rounding errors."""

import warnings
from typing import Any

import numpy as np
import pytest
from mechanisms import rectangle

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
INTEGRATORS = {"auto": None, "ida": bd.Ida(), "fixed": bd.GeneralizedAlpha(1e-3)}


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("output_step", [0.05, 5e-3])
@pytest.mark.parametrize("integrator", INTEGRATORS.values(), ids=INTEGRATORS)
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
