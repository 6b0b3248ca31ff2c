"""Warnings about growing modes: unstable loops, vibrations that a run lacks, unstable paths."""

import re

import casadi as ca
import numpy as np
import pytest
import scipy.linalg as la

import beamdae as bd

STEEL = bd.Material.of("steel")
STEP = 1e-3  # m, of the target of loops
SENTENCES = ("its loop is unstable", "the results lack it", "stays on an unstable path")


def list_warnings(mech, t_end, method=None):
    run = bd.simulate(mech, method or bd.Radau(), t_end=t_end)
    # The reason of a companion run that stops may be an unstable loop, too.
    own = (x for x in run.warnings if not x.startswith("errors: "))
    return [x for x in own if any(y in x for y in SENTENCES)]


def start_slowly(size, duration):
    return lambda t: size * (t / duration) ** 3 * (10 - 15 * t / duration + 6 * (t / duration) ** 2)


# ---- Continuous loops -----------------------------------------------------------------------

MASS, RATE, DAMPING = 2.0, 30.0, 0.6


def pid_gains(gain, rate=RATE, damping=DAMPING):
    """Return stiffness, kp, ki, kd; `gain` is ki relative to the limit of stability (Routh)."""
    stiffness = MASS * rate**2
    kp, kd = 4.0 * stiffness, damping * MASS * rate
    return stiffness, kp, gain * kd * (stiffness + kp) / MASS, kd


def build_stage(gain, rate=RATE, limit=None, by_formula=False, speed=0.0, damping=DAMPING):
    """Return a mass on a spring with a PID loop, whose limits are relative to the final force."""
    stiffness, kp, ki, kd = pid_gains(gain, rate, damping)
    limits = None if limit is None else (-limit * stiffness * STEP, limit * stiffness * STEP)
    mech = bd.Mechanism()
    stage = mech.add(bd.PointMass("stage", MASS, at=(0.0, 0.0), velocity=(speed, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), stage.point))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), stage.point, stiffness))
    x, v = (mech.sensor(name, stage.point, name) for name in ("x", "x_dot"))
    error = mech.input("target", 0.0 if speed else STEP) - x
    if by_formula:
        command = bd.transfer_function(mech, "servo", error, [kp, ki], [1.0, 0.0], scale=STEP)
        force = 0.5 * ca.fmax(ca.fmin(2.0 * (command - kd * v), 2 * limits[1]), 2 * limits[0])
    else:
        gains = {"kp": kp, "ki": ki, "kd": kd}
        force = bd.pid(mech, "servo", error, **gains, rate=-v, limits=limits, scale=STEP)
    mech.add(bd.Force("motor", stage.point, (force, 0.0)))
    return mech


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("limit", [None, 1.5, 30.0])
@pytest.mark.parametrize(
    ("rate", "method"),
    [(3.0, bd.Ida()), (30.0, bd.Radau()), (300.0, bd.GeneralizedAlpha(2e-5))],
    ids=["slow", "medium", "fast"],
)
@pytest.mark.parametrize("gain", [0.5, 0.8, 1.5, 20.0])
def test_unstable_loops_of_all_gains_speeds_and_limits_have_a_warning(gain, rate, method, limit):
    # Without limits, fast growth would end the run.
    t_end = 120.0 / rate if limit else (4.0 if gain > 2.0 else 30.0) / rate
    stiffness, kp, ki, kd = pid_gains(gain, rate)
    roots = np.roots([MASS, kd, stiffness + kp, ki])
    found = list_warnings(build_stage(gain, rate, limit), t_end, method)
    assert len(found) == (gain > 1.0)
    if found:
        fastest = roots[np.argmax(roots.real)]
        growth, frequency = re.search(r"exp\((\S+) t\) with (\S+) Hz", found[0]).groups()
        assert found[0].startswith("servo: the command does not settle")
        assert np.isclose(float(growth), fastest.real, rtol=0.01)
        assert np.isclose(float(frequency), abs(fastest.imag) / (2.0 * np.pi), rtol=0.01)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("gain", "is_unstable"), [(0.5, False), (3.0, True)])
def test_limits_in_formulas_of_users_are_those_of_loops(gain, is_unstable):
    mech = build_stage(gain, limit=3.0, by_formula=True)
    assert len(list_warnings(mech, 4.0)) == is_unstable


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("limit", [1e-3, 0.1])
@pytest.mark.parametrize("periods", [5, 100])
def test_weak_actuators_that_damp_large_vibrations_have_no_warning(limit, periods):
    mech = build_stage(0.1, limit=limit, speed=30.0 * STEP)
    assert not list_warnings(mech, periods * 2.0 * np.pi / RATE)


@pytest.mark.slow(reason="a fifth of a second")
def test_resonances_that_grow_slowly_belong_to_no_loop():
    stiffness, kp, ki, kd = pid_gains(0.9, damping=0.02)
    roots = np.roots([MASS, kd, stiffness + kp, ki])
    slowest = roots[np.argmax(roots.real)]
    assert slowest.real < 0.0
    mech, frequency = build_stage(0.9, damping=0.02), abs(slowest.imag)
    hum = (lambda t: 0.1 * np.sin(frequency * t), 0.0)
    mech.add(bd.Force("hum", mech.parts["stage"].point, hum))
    assert not list_warnings(mech, 10.0 * 2.0 * np.pi / frequency)


@pytest.mark.parametrize("gain", [5.0, 60.0])
def test_equilibria_that_are_unstable_without_the_loop_have_no_warning(gain):
    """A loop cannot destabilize a pendulum that stands upright."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    rod = mech.add(bd.RigidBody("rod", 1.0, 0.03, center=(0.0, 0.3)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    x, v = (mech.sensor(name, rod.at(0.0, 0.3), name) for name in ("angle", "angle_dot"))
    mech.add(bd.Moment("motor", rod.at(0.0, 0.0), bd.pid(mech, "servo", -x, gain, kd=1.0, rate=-v)))
    mech.add(bd.Moment("push", rod.at(0.0, 0.0), bd.sine(0.01, 1.0)))
    assert not list_warnings(mech, 3.0, bd.GeneralizedAlpha(5e-3))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("limit", [0.2, 2.0])
def test_periodic_loads_of_turning_parts_have_no_warning(limit):
    """A motor drives an unbalanced wheel; its torque reaches the limits in each revolution."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=0.5, center=(0.1, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    rate = mech.sensor("rate", wheel.at(0.0, 0.0), "angle_dot")
    torque = bd.pid(mech, "drive", 10.0 - rate, kp=50.0, ki=20.0, limits=(-limit, limit))
    mech.add(bd.Moment("motor", wheel.at(0.0, 0.0), torque))
    assert not list_warnings(mech, 30.0)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("gain", [0.01, 50.0])
def test_speed_loops_whose_commands_are_beyond_their_limits_at_rest(gain):
    """A motor and a load at both ends of a shaft; the loop measures the speed of the load."""
    motor, load, stiffness, damping = 0.01, 0.05, 200.0, 0.02
    mech = bd.Mechanism()
    parts = [mech.add(bd.RigidBody(f"disk {x}", 1.0, inertia=x)) for x in (motor, load)]
    ends = [x.at(0.0, 0.0) for x in parts]
    for k, end in enumerate(ends):
        mech.add(bd.Revolute(f"bearing {k}", mech.ground.at(0.0, 0.0), end))
    mech.add(bd.TorsionSpring("shaft", *ends, stiffness))
    mech.add(bd.TorsionDamper("losses", *ends, damping))
    error = 10.0 - mech.sensor("speed", ends[1], "angle_dot")
    torque = bd.pid(mech, "drive", error, gain, 2.0 * gain, limits=(-20.0, 20.0))
    mech.add(bd.Moment("motor", ends[0], torque))
    # Twist, speeds of motor and load, integral of the error
    loop = [
        [0.0, 1.0, -1.0, 0.0],
        [-stiffness / motor, -damping / motor, (damping - gain) / motor, 2.0 * gain / motor],
        [stiffness / load, damping / load, -damping / load, 0.0],
        [0.0, 0.0, -1.0, 0.0],
    ]
    is_unstable = la.eigvals(loop).real.max() > 0.0
    assert is_unstable == (gain > 1.0)
    assert len(list_warnings(mech, 4.0)) == is_unstable


def build_flexure(gain, sign=1.0):
    """Return a stage on two leaves whose force depends on the rate."""
    leaf = bd.Section.rectangle(STEEL, width=0.02, height=0.3e-3, damping=1e-4)
    mech = bd.Mechanism()
    platform = mech.add(bd.RigidBody.plate("platform", (0.0, 0.05), 0.08, 0.02, mass=0.5))
    for name, x in (("left", -0.03), ("right", 0.03)):
        curve = bd.Line((x, 0.0), (x, 0.04))
        beam = mech.add(bd.Beam(name, curve, leaf, elements=2, formulation="exact"))
        mech.add(bd.Weld(f"{name} clamp", mech.ground.at(x, 0.0), beam.start))
        mech.add(bd.Weld(f"{name} screw", beam.end, platform.at(x, 0.04)))
    middle = platform.at(0.0, 0.05)
    x, v = mech.sensor("x", middle, "x"), mech.sensor("v", middle, "x_dot")
    kp, kd = gain * 25e3, gain * 30.0
    force = bd.pid(mech, "servo", 1e-4 - x, kp, 60.0 * kp, kd, rate=-sign * v, scale=1e-6)
    mech.add(bd.Force("coil", middle, (force, 0.0)))
    return mech


@pytest.mark.slow(reason="seconds")
@pytest.mark.parametrize("method", [bd.Radau(max_steps=1000), bd.GeneralizedAlpha(2e-4)])
def test_unstable_loops_are_the_first_reason_of_runs_that_stop(method):
    with pytest.warns(bd.BeamdaeWarning):
        run = bd.simulate(build_flexure(1.0, sign=-1.0), method, t_end=1.0)
    assert not run.status.success
    cause = (
        r"stopped at t = \S+ s: servo: the command does not settle, because its loop is unstable"
    )
    assert re.match(cause, run.status.sentence)
    assert not any("its loop" in x for x in run.warnings)


# ---- Sampled loops --------------------------------------------------------------------------

SAMPLED = {"mass": 0.8, "stiffness": 15e3, "kp": 20e3, "ki": 8e5}


def build_sampled_stage(every, kd, limit=np.inf, noise=0.0, resolution=0.0, delay=0):
    """Return a mass on a spring with a sampled PID controller."""
    mass, stiffness, kp, ki = SAMPLED.values()
    mech = bd.Mechanism()
    stage = mech.add(bd.PointMass("stage", mass, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), stage.point))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), stage.point, stiffness))
    force = mech.input("force", unit="N")
    mech.add(bd.Force("actuator", stage.point, (force, 0.0)))

    def law(sample):
        x = sample.reads[0] + noise * sample.random.normal()
        x = resolution * np.round(x / resolution) if resolution else x
        integral, last = sample.state
        error = 0.5 * STEP - x
        wanted = kp * error + ki * integral - kd * (x - last) / every
        command = float(np.clip(wanted, -limit, limit))
        sample.state[:] = integral + every * (error + (command - wanted) / kp), x
        return command

    reads = [mech.sensor("position", stage.point, "x")]
    mech.add(bd.Controller("servo", every, reads, [force], law, state=[0.0, 0.0], delay=delay))
    return mech


def measure_radius(every, kd, delay=0):
    """Return the spectral radius of the loop without its limit: x, v, integral, last, commands."""
    mass, stiffness, kp, ki = SAMPLED.values()
    continuous = np.array([[0.0, 1.0, 0.0], [-stiffness / mass, 0.0, 1.0 / mass], [0.0] * 3])
    step = la.expm(every * continuous)
    size = 5 + delay
    motion, sample = np.eye(size), np.eye(size)
    motion[:2, [0, 1, 4]] = step[:2]
    for k in range(4, size - 1):
        sample[k] = np.eye(size)[k + 1]
    sample[-1] = 0.0
    sample[-1, [0, 2, 3]] = -kp - kd / every, ki, kd / every
    sample[2, 0], sample[3] = -every, np.eye(size)[0]
    return np.abs(la.eigvals(motion @ sample)).max()


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("limit", [12.0, np.inf])
@pytest.mark.parametrize(
    ("every", "kd", "delay"),
    [
        (5e-5, 300.0, 0),
        (5e-5, 36e3, 0),
        (5e-4, 150.0, 0),
        (5e-4, 3000.0, 0),
        (5e-4, 3600.0, 0),
        (5e-4, 150.0, 3),
        (2e-3, 150.0, 0),
        (2e-3, 800.0, 0),
    ],
)
def test_unstable_sampled_loops_have_a_warning(every, kd, delay, limit):
    radius = measure_radius(every, kd, delay)
    assert radius < 0.9996 or radius > 1.01
    mech = build_sampled_stage(every, kd, limit, delay=delay)
    found = list_warnings(mech, 120.0 * every, bd.GeneralizedAlpha(every / 4.0))
    assert len(found) == (radius > 1.0)
    if found:
        assert found[0].startswith("servo: force does not settle, because its loop is unstable")
        growth = float(re.search(r"exp\((\S+) t\)", found[0])[1])
        assert np.isclose(growth, np.log(radius) / every, rtol=0.02)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("settings", [{"noise": 1e-6}, {"resolution": 1e-8}])
def test_loops_with_noise_and_encoders_are_linearized(settings):
    for kd, is_unstable in ((150.0, False), (3600.0, True)):
        mech = build_sampled_stage(5e-4, kd, limit=12.0, **settings)
        found = list_warnings(mech, 0.06, bd.GeneralizedAlpha(1.25e-4))
        assert len(found) == is_unstable


def build_wheel(law, every=0.05, inertia=0.5):
    """Return a wheel whose moment follows a sampled law of angle and rate."""
    mech = bd.Mechanism()
    wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=inertia))
    at = wheel.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), at))
    torque = mech.input("torque", unit="N m")
    mech.add(bd.Moment("motor", at, torque))
    reads = [mech.sensor("angle", at, "angle"), mech.sensor("rate", at, "angle_dot")]
    mech.add(bd.Controller("servo", every, reads, [torque], law))
    return mech


@pytest.mark.parametrize(
    ("law", "is_unstable"),
    [
        (lambda sample: 20.0 * sample.reads[0] + 1e-6, True),
        (lambda sample: 8.0 * (1.0 - sample.reads[0]) - 22.0 * sample.reads[1], True),
        (lambda sample: 8.0 * (1.0 - sample.reads[0]) - 4.0 * sample.reads[1], False),
        (lambda sample: 8.0 * ((sample.t > 2.0) - sample.reads[0]) - 4.0 * sample.reads[1], False),
        (lambda sample: 1.0 if sample.reads[0] < 0.5 else -1.0, False),
        (lambda sample: sample.t**3, False),
    ],
    ids=["positive feedback", "late sample", "stable", "set point", "relay", "open"],
)
@pytest.mark.parametrize("method", [bd.Radau(), bd.GeneralizedAlpha(5e-3)])
def test_loops_of_a_wheel(law, is_unstable, method):
    assert len(list_warnings(build_wheel(law), 2.5, method)) == is_unstable


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("gain", "is_unstable"), [(0.3, False), (1.2, False), (2.5, True)])
def test_cascades_of_two_sampling_intervals_are_linearized(gain, is_unstable):
    """The inner loop multiplies a deviation of the rate by 1 - gain."""
    inertia, every = 0.02, 2e-3

    def inner(sample):
        reference, rate = sample.reads
        return float(np.clip(gain * inertia / every * (reference - rate), -0.5, 0.5))

    mech = bd.Mechanism()
    rotor = mech.add(bd.RigidBody("rotor", mass=1.0, inertia=inertia))
    at = rotor.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), at))
    torque, reference = mech.input("torque", unit="N m"), mech.input("reference", unit="rad/s")
    mech.add(bd.Moment("motor", at, torque))
    angle, rate = mech.sensor("angle", at, "angle"), mech.sensor("rate", at, "angle_dot")
    outer = lambda sample: 15.0 * (0.2 - sample.reads[0])  # noqa: E731
    mech.add(bd.Controller("outer", 5 * every, [angle], [reference], outer))
    mech.add(bd.Controller("inner", every, [reference, rate], [torque], inner))
    assert len(list_warnings(mech, 1.0, bd.GeneralizedAlpha(5e-4))) == is_unstable


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
def test_the_recommended_step_resolves_an_unstable_loop():
    (sentence,) = list_warnings(build_arm(0.05), 1.0, bd.GeneralizedAlpha(0.01, rho_inf=0.5))
    assert sentence.startswith("motor: ")
    step = float(re.search(r"Radau\(max_step=([\d.e-]+)\)", sentence)[1])
    (sentence,) = list_warnings(build_arm(0.05), 0.6, bd.Radau(max_step=step))
    assert sentence.startswith("loop: the command does not settle, because its loop is unstable")


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
