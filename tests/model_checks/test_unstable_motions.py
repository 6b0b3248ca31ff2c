"""Warnings about growing modes: vibrations that a run lacks, and unstable paths."""

import re

import numpy as np
import pytest
import scipy.linalg as la

import beamdae as bd

STEEL = bd.Material.of("steel")
SENTENCES = ("the results lack it", "stays on an unstable path")


def list_warnings(mech, t_end, method=None):
    run = bd.simulate(mech, method or bd.Radau(), t_end=t_end)
    return [x for x in run.warnings if any(y in x for y in SENTENCES)]


def start_slowly(size, duration):
    return lambda t: size * (t / duration) ** 3 * (10 - 15 * t / duration + 6 * (t / duration) ** 2)


# ---- Vibrations that steps damp -------------------------------------------------------------

LENGTH, HEIGHT = 0.3, 0.1


def build_wiper(damping=0.0, static=0.45):
    """Return an arm that is pressed onto the ground and whose tip slides slowly."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    strip = bd.Section.rectangle(STEEL, width=0.01, height=0.0015, damping=damping)
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, HEIGHT), 0.02, mass=0.1))
    line = bd.Line((0.0, HEIGHT), (np.sqrt(LENGTH**2 - HEIGHT**2), 0.0))
    arm = mech.add(bd.Beam("arm", line, strip, elements=4, formulation="exact"))
    bearing = mech.ground.at(0.0, HEIGHT), hub.at(0.0, HEIGHT)
    mech.add(bd.Revolute("bearing", *bearing))
    mech.add(bd.Weld("clamp", hub.at(0.0, HEIGHT), arm.start))
    mech.add(bd.Driver("motor", *bearing, start_slowly(np.radians(-5.0), 0.3)))
    surface = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"restitution": 0.3, "impact_speed": 0.1, "friction": 0.3}
    stribeck = {} if static is None else {"static": static, "stribeck": 5e-3}
    mech.add(bd.Contact("lip", arm.end, surface, 1e6, **law, **stribeck))
    return mech


def build_column(ratio):
    """Return a column under a follower load, relative to the limit of flutter (Beck 1952)."""
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.001)
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (0.0, LENGTH))
    column = mech.add(bd.Beam("column", line, section, elements=4, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), column.start))
    thrust = -ratio * 20.05 * section.EI / LENGTH**2
    law = bd.piecewise((0.2, start_slowly(thrust, 0.2)), thrust)
    mech.add(bd.Force("thrust", column.end, (0.0, law), axes="body"))
    return mech


def build_arm(kd):
    """Return an arm whose motor follows the angle of its tip."""
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.004)
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), 0.03, mass=0.3))
    line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
    arm = mech.add(bd.Beam("arm", line, section, elements=4, formulation="exact"))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("clamp", hub.at(0.0, 0.0), arm.start))
    error = mech.input("target", start_slowly(0.3, 1.0)) - mech.sensor("angle", arm.end, "angle")
    command = bd.pid(mech, "loop", error, 10.0 * kd, kd=kd, filter_time=1e-3)
    mech.add(bd.Moment("motor", hub.at(0.0, 0.0), command))
    return mech


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize("method", [bd.Auto(), bd.Ida()])
def test_squeal_that_steps_damp_has_a_warning(method):
    (sentence,) = list_warnings(build_wiper(), 0.2, method)
    assert sentence.startswith("lip: ")
    # A quarter wave of the bar speed of steel along the arm
    frequency = float(re.search(r"at (\S+) Hz", sentence)[1])
    assert np.isclose(frequency, np.sqrt(STEEL.E / STEEL.rho) / (4 * LENGTH), rtol=0.05)


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize("changes", [{"damping": 1e-4}, {"static": None}])
def test_damped_vibrations_and_constant_friction_have_no_warning(changes):
    assert not list_warnings(build_wiper(**changes), 0.2)


@pytest.mark.slow(reason="a second")
@pytest.mark.parametrize(("ratio", "count"), [(0.9, 0), (1.2, 1), (2.2, 1)])
def test_flutter_from_rest_has_a_warning_above_its_limit(ratio, count):
    found = list_warnings(build_column(ratio), 1.0)
    assert len(found) == count
    assert all(x.startswith("thrust: ") for x in found)


@pytest.mark.slow(reason="seconds")
def test_the_growth_of_flutter_is_that_of_a_run_with_short_steps():
    (sentence,) = list_warnings(build_column(1.2), 1.0)
    numbers = re.search(r"at (\S+) Hz grows as exp\((\S+) t", sentence).groups()
    frequency, rate = map(float, numbers)
    mech = build_column(1.2)
    # A push of 1 uN for 0.1 s
    mech.add(bd.Force("push", mech.parts["column"].end, (bd.piecewise((0.1, 1e-6), 0.0), 0.0)))
    mech.observe("tip", mech.parts["column"].end)
    short = bd.simulate(mech, bd.Radau(1e-8, max_step=5e-4), t_end=0.35, output_step=1e-4)
    early = (short.t > 0.23) & (short.t < 0.25)
    later = np.interp(short.t[early] + 2.0 / frequency, short.t, short["tip.x [m]"])
    growth = la.norm(later) / la.norm(short["tip.x [m]"][early])
    assert np.isclose(np.log(growth) * frequency / 2.0, rate, rtol=0.05)


@pytest.mark.slow(reason="a second")
def test_the_recommended_step_shows_the_vibration_of_an_unstable_loop():
    (sentence,) = list_warnings(build_arm(0.05), 1.0, bd.GeneralizedAlpha(0.01, rho_inf=0.5))
    assert sentence.startswith("motor: ")
    step = float(re.search(r"Radau\(max_step=([\d.e-]+)\)", sentence)[1])
    assert not list_warnings(build_arm(0.05), 0.6, bd.Radau(max_step=step))


def test_rigid_bodies_that_slide_to_rest_have_no_vibrations():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    block = mech.add(bd.RigidBody("block", 1.0, inertia=0.1, velocity=(2.0, 0.0)))
    guide = mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.0), block.at(0.0, 0.0)))
    law = {"friction_speed": 1e-3, "static": 0.5, "stribeck": 0.05, "radius": 0.1}
    mech.add(bd.Friction("friction", guide, coefficient=0.3, **law))
    assert not list_warnings(mech, 1.0)


# ---- Unstable paths -------------------------------------------------------------------------

STRIP = bd.Section.rectangle(STEEL, width=0.02, height=0.002, damping=2e-4)
SPAN = 0.5  # m
BUCKLING_LOAD = np.pi**2 * STRIP.EI / (4.0 * SPAN**2)  # N, of a cantilever (Euler)


def build_cantilever(load, side_load=0.0, formulation="exact"):
    """Return a cantilever that is compressed by a force, a number or a function of time."""
    mech = bd.Mechanism()
    line = bd.Line((0, 0), (SPAN, 0))
    rod = mech.add(bd.Beam("rod", line, STRIP, elements=2, formulation=formulation))
    mech.add(bd.Weld("clamp", mech.ground.at(0, 0), rod.start))
    mech.add(bd.Force("press", rod.end, (load, side_load)))
    return mech


def build_arch(load):
    """Return a pinned arch with a load at its crown that increases with time."""
    radius, half = 0.3625, np.arcsin(0.25 / 0.3625)
    curve = bd.Arc(radius, 2.0 * half * radius, start=(0.25, 0.0), angle=np.pi - half)
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.002, damping=2e-3)
    mech = bd.Mechanism()
    arch = mech.add(bd.Beam("arch", curve, section, elements=8, formulation="exact"))
    for name, end in (("right", arch.start), ("left", arch.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*end.point), end))
    force = (0.0, lambda t: -load * t / 0.5)
    mech.add(bd.Force("press", arch.at(0.5 * arch.length), force))
    return mech


def add_turning_beam(mech):
    rotor = mech.add(bd.Beam("rotor", bd.Line((1, 0), (1.2, 0)), STRIP, elements=1))
    mech.add(bd.Revolute("axle", mech.ground.at(1, 0), rotor.start))
    mech.add(bd.Driver("motor", mech.ground.at(1, 0), rotor.start, lambda t: t))
    return mech


def add_holding_force(mech):
    tip = mech.part("rod").end
    y, v = (mech.sensor(name, tip, name) for name in ("y", "y_dot"))
    mech.add(bd.Force("hold", tip, (0.0, -1e4 * y - 10.0 * v)))
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    ("mech", "t_end", "part"),
    [
        (build_cantilever(-0.9 * BUCKLING_LOAD), 2.0, ""),
        (build_cantilever(-1.5 * BUCKLING_LOAD), 2.0, "rod"),
        (build_cantilever(-20.0 * BUCKLING_LOAD), 2.0, "rod"),
        (build_cantilever(-1.5 * BUCKLING_LOAD, formulation="floating frame"), 2.0, "rod"),
        (build_cantilever(-1.5 * BUCKLING_LOAD, -1e-3 * BUCKLING_LOAD), 0.5, ""),
        (
            build_cantilever(lambda t: -3.0 * BUCKLING_LOAD * np.exp(-(((t - 0.8) / 0.3) ** 2))),
            2.0,
            "rod",
        ),
        (build_cantilever(lambda t: -BUCKLING_LOAD * (0.6 + 0.8 * np.sin(600.0 * t))), 0.3, ""),
        # The path branches at 336 N, before its limit point at 389 N (`bd.equilibrium`).
        (build_arch(320.0), 0.5, ""),
        (build_arch(380.0), 0.5, "arch"),
        (add_turning_beam(build_cantilever(-0.9 * BUCKLING_LOAD)), 1.0, ""),
        (add_turning_beam(build_cantilever(-1.5 * BUCKLING_LOAD)), 1.0, "rod"),
        (add_holding_force(build_cantilever(-1.5 * BUCKLING_LOAD)), 1.0, ""),
    ],
    ids=[
        "stable",
        "above",
        "far above",
        "frame",
        "buckles",
        "at times",
        "vibrates",
        "arch below",
        "arch",
        "rotor below",
        "rotor",
        "held",
    ],
)
def test_runs_that_stay_on_an_unstable_path_have_a_warning(mech, t_end, part):
    found = list_warnings(mech, t_end, bd.Auto())
    assert len(found) == bool(part)
    assert all(x.startswith(f"{part}: ") for x in found)


@pytest.mark.slow(reason="a second")
def test_a_bar_that_vibrates_in_flight_is_on_no_unstable_path():
    """Forces of the vibration turn with the bar, whose rotation has a stiffness of either sign."""
    section = bd.Section.rectangle(STEEL, width=0.02, height=0.005)
    mech = bd.Mechanism()
    line = bd.Line((0, 0), (SPAN, 0))
    bar = mech.add(bd.Beam("bar", line, section, elements=1, formulation="exact"))
    for end, size in ((bar.start, 2e4), (bar.end, -2e4)):
        mech.add(bd.PointMass(f"mass at {end}", 0.1, on=end))
        mech.add(
            bd.Force(f"blow at {end}", end, (lambda t, size=size: size * np.exp(-t / 1e-4), 0.0))
        )
    assert not list_warnings(mech, 0.01, bd.Auto())
