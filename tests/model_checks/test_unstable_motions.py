"""Warnings about slow motions that the smallest disturbance leaves."""

import numpy as np
import pytest
from mechanisms import EARTH, clamped_beam, rectangle

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


def add_rotor(mech):
    at = (
        mech.ground.at(1.0, 0.0),
        mech.add(bd.RigidBody("rotor", 1.0, 0.1, (1.0, 0.0))).at(1.0, 0.0),
    )
    mech.add(bd.Revolute("axle", *at))
    mech.add(bd.Driver("motor", *at, lambda t: t))
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
        (add_rotor(build_cantilever(-1.5 * BUCKLING_LOAD)), 1.0, True),
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
        "beside a rotor",
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
