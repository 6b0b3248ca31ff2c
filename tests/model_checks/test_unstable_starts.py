"""Warnings of runs that start in an unstable equilibrium, and runs in which nothing moves."""

import re
import warnings

import numpy as np
import pytest
from mechanisms import hinged_body, rectangle

import beamdae as bd


def toggle(length, **options):
    """Return a crown between two springs in a line, of 1 m each, with this natural length [m].

    The stiffness sideways is 2 k (1 - length), where k is the stiffness of a spring.
    """
    mech = bd.Mechanism(**options)
    crown = mech.add(bd.PointMass("crown", 1.0, at=(0.0, 0.0)))
    for side in (-1.0, 1.0):
        foot = mech.ground.at(0.0, side)
        mech.add(
            bd.Spring(f"spring {side:g}", foot, crown.point, stiffness=1e3, free_length=length)
        )
    mech.observe("crown", crown.point)
    return mech


def list_start_warnings(mech, t_end=1.0, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = bd.simulate(mech, bd.Radau(1e-6), t_end, **options)
    return [x for x in run.warnings if "unstable" in x]


def test_regression_a_start_in_an_unstable_equilibrium_carries_a_warning():
    """Compressed springs in a line push the crown sideways; the run stayed without a warning."""
    # The crown has 1 kg and the stiffness -200 N/m sideways.
    message = r"start: the equilibrium is unstable, and .* leaves it as exp\(14.1 t\); "
    for found in (
        list_start_warnings(toggle(1.1), start="equilibrium"),
        list_start_warnings(toggle(1.1, start="equilibrium")),
    ):
        assert len(found) == 1
        assert re.match(message, found[0])
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.simulate(toggle(1.1), bd.Radau(1e-6), 1.0, start="equilibrium")
    assert not list_start_warnings(toggle(1.1), t_end=0.1, start="equilibrium")


@pytest.mark.parametrize("length", [0.9, 1.0])
def test_stable_and_neutral_equilibria_start_without_a_warning(length):
    """Springs at their natural length have no stiffness sideways."""
    assert not list_start_warnings(toggle(length), start="equilibrium")
    assert not list_start_warnings(toggle(1.1))


@pytest.mark.parametrize(("stiffness", "is_stable"), [(4.8, False), (5.0, True)])
def test_an_upright_pendulum_is_stable_above_the_critical_stiffness_of_its_pivot(
    stiffness, is_stable
):
    """The critical stiffness is m g s = 4.905 N m/rad."""
    mech, rod = hinged_body(1.0, 0.1, (0.0, 0.5), name="rod", gravity=9.81, start="equilibrium")
    mech.add(bd.TorsionSpring("hold", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0), stiffness))
    mech.observe("rod", rod.at(0.0, 0.5))
    assert bool(list_start_warnings(mech, t_end=30.0)) is not is_stable


@pytest.mark.filterwarnings("error::beamdae.errors.BeamdaeWarning")
def test_regression_rounding_errors_of_a_loaded_structure_at_rest_are_no_missed_peaks():
    """Velocities of 1e-13 m/s had larger values between the rows."""
    steel = bd.Material(E=2e11, nu=0.3, rho=7800.0)
    section = rectangle(4e-4, 0.01, damping=1e-5, material=steel)
    mech = bd.Mechanism(start="equilibrium")
    arch = bd.Curve(lambda x: 1.5e-3 * (1.0 - np.cos(2.0 * np.pi * x / 0.12)), x=(0.0, 0.12))
    beam = mech.add(bd.Beam("arch", arch, section, elements=8, formulation="exact"))
    for name, end in (("left", beam.start), ("right", beam.end)):
        mech.add(bd.Weld(name, mech.ground.at(*end.point), end))
    mech.add(bd.Force("press", beam.at(0.5 * beam.length), (0.0, -6.0)))
    for share in (0.25, 0.5):
        mech.observe(f"at {share:g}", beam.at(share * beam.length))
    bd.simulate(mech, t_end=5e-3, output_step=5e-4)


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore:start. the equilibrium is unstable:beamdae.BeamdaeWarning")
@pytest.mark.filterwarnings("error:.*(output rows|fast vibrations):beamdae.BeamdaeWarning")
def test_regression_velocities_of_bodies_at_rest_are_rounding_errors():
    """A velocity of 6e-15 m/s had an error of 75 %, and its largest value between the rows."""
    length, inertia = 0.05 * np.sqrt(0.5), 2e-4
    titanium = bd.Material(E=114e9, nu=0.33, rho=4430.0)
    section = rectangle(0.25e-3, 0.01, damping=1e-4, material=titanium)
    mech = bd.Mechanism()
    stage = mech.add(bd.RigidBody("stage", 0.3, inertia, center=(0.0, 0.5 * length)))
    for name, side in (("a", 0.5 * length), ("b", -0.5 * length)):
        line = bd.Line((-side, 0.0), (side, length))
        beam = mech.add(bd.Beam(name, line, section, elements=4, formulation="exact"))
        mech.add(bd.Weld(f"{name} foot", mech.ground.at(-side, 0.0), beam.start))
        mech.add(bd.Weld(f"{name} head", beam.end, stage.at(side, length)))
    mech.add(bd.Force("load", stage.at(0.0, 0.5 * length), (0.0, 5.0)))
    mech.observe("stage", stage.at(0.0, 0.5 * length))
    run = bd.simulate(mech, t_end=2.0, start="equilibrium")
    assert run["stage.y_dot"].abs().max() < 1e-13


@pytest.mark.parametrize(("friction", "is_unstable"), [(0.0, True), (0.3, False)])
def test_friction_holds_an_unstable_equilibrium(friction, is_unstable):
    mech = toggle(1.1)
    crown = mech.parts["crown"].point
    mech.add(bd.Force("weight", crown, (0.0, -10.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("floor", crown, floor, 1e5, friction=friction))
    assert bool(list_start_warnings(mech, start="equilibrium")) is is_unstable
