"""Warnings about unstable motions and starts."""

import re
import warnings

import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, hinged_body, rectangle

import beamdae as bd


def list_warnings(mech, t_end, method=None):
    run = bd.simulate(mech, method or bd.Radau(), t_end=t_end)
    return [x for x in run.warnings if "slow but unstable" in x]


def start_slowly(size, duration):
    return lambda t: size * (t / duration) ** 3 * (10 - 15 * t / duration + 6 * (t / duration) ** 2)


LENGTH = 0.3


def build_column(ratio):
    """Return a column under a follower load, relative to the limit of flutter (Beck 1952)."""
    section = rectangle(0.001)
    mech, column = clamped_beam(section, 4, (0.0, LENGTH), name="column", formulation="exact")
    thrust = -ratio * 20.05 * section.EI / LENGTH**2
    law = bd.piecewise((0.2, start_slowly(thrust, 0.2)), thrust)
    mech.add(bd.Force("thrust", column.end, (0.0, law), axes="body"))
    return mech


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize(("ratio", "count"), [(0.9, 0), (1.2, 1), (2.2, 1)])
def test_flutter_from_rest_has_a_warning_above_its_limit(ratio, count):
    found = list_warnings(build_column(ratio), 1.0)
    assert len(found) == count


def test_rigid_bodies_that_slide_to_rest_have_no_vibrations():
    mech = bd.Mechanism(gravity=EARTH)
    block = mech.add(bd.RigidBody("block", 1.0, inertia=0.1, velocity=(2.0, 0.0)))
    guide = mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), block.at(0.0, 0.0)))
    law = {"friction_speed": 1e-3, "static": 0.5, "stribeck": 0.05, "radius": 0.1}
    mech.add(bd.Friction("friction", guide, coefficient=0.3, **law))
    assert not list_warnings(mech, 1.0)


# ---- Unstable paths -------------------------------------------------------------------------
STRIP = rectangle(0.002, damping=2e-4)
SPAN = 0.5  # m

BUCKLING_LOAD = np.pi**2 * STRIP.EI / (4.0 * SPAN**2)  # N, of a cantilever (Euler)


def build_cantilever(load, side_load=0.0, formulation="exact"):
    """Return a cantilever that is compressed by a force, a number or a function of time."""
    mech, rod = clamped_beam(STRIP, 2, SPAN, name="rod", formulation=formulation)
    mech.add(bd.Force("press", rod.end, (load, side_load)))
    return mech


def build_arch(load):
    """Return a pinned arch with a load at its crown that increases with time."""
    radius, half = 0.3625, np.arcsin(0.25 / 0.3625)
    curve = bd.Arc(radius, 2.0 * half * radius, start=(0.25, 0.0), angle=np.pi - half)
    section = rectangle(0.002, damping=2e-3)
    mech = bd.Mechanism()
    arch = mech.add(bd.Beam("arch", curve, section, elements=8, formulation="exact"))
    for name, end in (("right", arch.start), ("left", arch.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*end.point), end))
    force = (0.0, lambda t: -load * t / 0.5)
    mech.add(bd.Force("press", arch.at(0.5 * arch.length), force))
    return mech


def add_holding_force(mech):
    tip = mech.part("rod").end
    y, v = (mech.sensor(name, tip, name) for name in ("y", "y_dot"))
    mech.add(bd.Force("hold", tip, (0.0, -1e4 * y - 10.0 * v)))
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    ("mech", "t_end", "is_unstable"),
    [
        (build_cantilever(-0.9 * BUCKLING_LOAD), 2.0, False),
        (build_cantilever(-1.5 * BUCKLING_LOAD), 2.0, True),
        (build_cantilever(-20.0 * BUCKLING_LOAD), 2.0, True),
        (build_cantilever(-1.5 * BUCKLING_LOAD, formulation="floating frame"), 2.0, True),
        (build_cantilever(-1.5 * BUCKLING_LOAD, -1e-3 * BUCKLING_LOAD), 0.5, False),
        (build_cantilever(lambda t: -BUCKLING_LOAD * (0.6 + 0.8 * np.sin(600.0 * t))), 0.3, False),
        # The path branches at 336 N, before its limit point at 389 N (`bd.equilibrium`).
        (build_arch(320.0), 0.5, False),
        (build_arch(380.0), 0.5, True),
        (add_holding_force(build_cantilever(-1.5 * BUCKLING_LOAD)), 1.0, False),
    ],
    ids=[
        "stable",
        "above",
        "far above",
        "frame",
        "buckles",
        "vibrates",
        "arch below",
        "arch",
        "held",
    ],
)
def test_runs_that_stay_on_an_unstable_path_have_a_warning(mech, t_end, is_unstable):
    found = list_warnings(mech, t_end, bd.Auto())
    assert len(found) == is_unstable


@pytest.mark.slow(reason="a second")
def test_a_bar_that_vibrates_in_flight_is_on_no_unstable_path():
    """Forces of the vibration turn with the bar, whose rotation has a stiffness of either sign."""
    section = rectangle(0.005)
    mech = bd.Mechanism()
    line = bd.Line((0, 0), (SPAN, 0))
    bar = mech.add(bd.Beam("bar", line, section, elements=1, formulation="exact"))
    for end, size in ((bar.start, 2e4), (bar.end, -2e4)):
        mech.add(bd.PointMass(f"mass at {end}", 0.1, on=end))
        mech.add(
            bd.Force(f"blow at {end}", end, (lambda t, size=size: size * np.exp(-t / 1e-4), 0.0))
        )
    assert not list_warnings(mech, 0.01, bd.Auto())


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
