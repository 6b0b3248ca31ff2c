"""Warnings about continuous loops that grow, or go from limit to limit."""

import re
import warnings

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd

STEP = 1e-3


def build_stage(gain, rate=30.0, limit=None, by_formula=False, speed=0.0, damping=0.6):
    """Return a mass of 2 kg on a spring of the natural frequency `rate` [rad/s] with a PID loop.

    `gain` is the integral gain relative to the limit of stability, kd (k + kp) / m. The `limit` is
    relative to the force that holds the target.
    """
    mass, stiffness = 2.0, 2.0 * rate**2
    kp, kd = 4.0 * stiffness, damping * mass * rate
    ki = gain * kd * (stiffness + kp) / mass
    limits = None if limit is None else (-limit * stiffness * STEP, limit * stiffness * STEP)
    mech = bd.Mechanism()
    stage = mech.add(bd.PointMass("stage", mass, at=(0.0, 0.0), velocity=(speed, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), stage.point))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), stage.point, stiffness))
    x, v = (mech.sensor(name, stage.point, name) for name in ("x", "x_dot"))
    error = mech.input("target", 0.0 if speed else STEP) - x
    if by_formula:
        # kp + ki / s, and the rate.
        command = bd.transfer_function(mech, "servo", error, [kp, ki], [1.0, 0.0], scale=STEP)
        force = 0.5 * ca.fmax(ca.fmin(2.0 * (command - kd * v), 2 * limits[1]), 2 * limits[0])
    else:
        gains = {"kp": kp, "ki": ki, "kd": kd}
        force = bd.pid(mech, "servo", error, **gains, rate=-v, limits=limits, scale=STEP)
    mech.add(bd.Force("motor", stage.point, (force, 0.0)))
    return mech


def loop_warnings(mech, t_end, method=None):
    run = bd.simulate(mech, method or bd.Radau(), t_end=t_end)
    return [x for x in run.warnings if "its loop seems to be unstable" in x]


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_limit_cycles_of_continuous_loops_have_a_warning():
    """A force that went from limit to limit until the end was "ok"."""
    (sentence,) = loop_warnings(build_stage(2.0, limit=3.0), t_end=4.0)
    limits = "alternates between its limits -5.4 and 5.4 until the end of the run (limit cycle)"
    assert sentence.startswith(f"servo: the command {limits}, so its loop seems to be unstable;")
    assert not loop_warnings(build_stage(0.5, limit=3.0), t_end=4.0)


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("method", [bd.Radau(), bd.Ida(), bd.GeneralizedAlpha(1.0)])
@pytest.mark.parametrize("rate", [3.0, 30.0, 300.0])
@pytest.mark.parametrize("limit", [1.5, 3.0, 30.0])
@pytest.mark.parametrize("gain", [0.1, 0.5, 0.8, 2.0, 5.0, 20.0, 100.0])
def test_regression_limit_cycles_are_found_at_all_gains_and_speeds(gain, limit, rate, method):
    if isinstance(method, bd.GeneralizedAlpha):
        method = bd.GeneralizedAlpha(6e-3 / rate)
    found = loop_warnings(build_stage(gain, rate, limit), 120.0 / rate, method)
    assert len(found) == (gain > 1.0)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(("gain", "is_unstable"), [(0.5, False), (3.0, True)])
def test_regression_limits_in_formulas_of_users_are_those_of_loops(gain, is_unstable):
    mech = build_stage(gain, limit=3.0, by_formula=True)
    found = loop_warnings(mech, t_end=4.0)
    assert len(found) == is_unstable
    assert all(x.startswith("motor: the limited value alternates between its") for x in found)


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("limit", [1e-3, 1e-2, 0.1])
@pytest.mark.parametrize("periods", [5, 20, 100])
def test_weak_actuators_that_damp_large_vibrations_have_no_warning(limit, periods):
    mech = build_stage(0.1, limit=limit, speed=30.0 * STEP)
    assert not loop_warnings(mech, t_end=periods * 2.0 * np.pi / 30.0)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("limit", [0.2, 0.5, 2.0])
def test_periodic_loads_of_turning_parts_have_no_warning(limit):
    """A motor drives an unbalanced wheel; its torque reaches the limits in each revolution."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=0.5, center=(0.1, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
    rate = mech.sensor("rate", wheel.at(0.0, 0.0), "angle_dot")
    gains = {"kp": 50.0, "ki": 20.0}
    torque = bd.pid(mech, "drive", 10.0 - rate, **gains, limits=(-limit, limit))
    mech.add(bd.Moment("motor", wheel.at(0.0, 0.0), torque))
    assert not loop_warnings(mech, t_end=30.0)


def build_flexure(gain, sign=1.0):
    """Return a stage on two leaves whose force depends on the rate with the wrong sign."""
    steel = bd.Material.of("steel")
    leaf = bd.Section.rectangle(steel, width=0.02, height=0.3e-3, damping=1e-4)
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


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("gain", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("method", [bd.Radau(max_steps=1000), bd.GeneralizedAlpha(2e-4)])
def test_regression_unstable_loops_are_the_first_reason_of_runs_that_stop(gain, method):
    """Newton's iteration, or the maximum of steps, was the only reason."""
    with pytest.warns(bd.BeamdaeWarning):
        run = bd.simulate(build_flexure(gain, sign=-1.0), method, t_end=1.0)
    assert not run.status.success
    cause = r"stopped at t = \S+ s: servo\S* (the command )?grows exponentially, by a factor of"
    assert re.match(cause, run.status.sentence)
    assert not any("its loop seems" in x for x in run.warnings)


def build_hard_stage(kp, kd, ki=0.0, goal=STEP, limits=None, damping=0.5):
    """Return a PID loop of a mass of 0.5 kg on a spring of 2000 N/m that becomes stiffer."""
    mech = bd.Mechanism()
    stage = mech.add(bd.PointMass("stage", 0.5, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), stage.point))

    def spring(state, t):
        x, v = state.position[0], state.velocity[0]
        return (-2e3 * x - 1e7 * x**3 - damping * v, 0.0)

    mech.add(bd.ForceLaw("spring", stage.point, spring))
    x, v = (mech.sensor(name, stage.point, name) for name in ("x", "x_dot"))
    error, options = mech.input("goal", goal) - x, {"limits": limits, "tracking_time": 0.1}
    force = bd.pid(mech, "servo", error, kp, ki, kd, rate=-v, scale=STEP, **options)
    mech.add(bd.Force("motor", stage.point, (force, 0.0)))
    return mech


def build_sampled_stage(every, kp, kd, ki=0.0, goal=STEP, limit=1e9, delay=0, resolution=None):
    """Return the stage of `build_hard_stage` with a sampled controller and an ideal encoder."""
    mech = build_hard_stage(0.0, 0.0)
    stage = mech.parts["stage"]
    force = mech.input("force", unit="N")
    mech.add(bd.Force("actuator", stage.point, (force, 0.0)))

    def law(sample):
        (x,) = sample.reads
        if resolution is not None:
            x = resolution * np.round(x / resolution)
        integral, last = sample.state
        error = goal - x
        integral += every * error
        sample.state[:] = integral, x
        command = kp * error + ki * integral - kd * (x - last) / every
        return float(np.clip(command, -limit, limit))

    reads = [mech.sensor("position", stage.point, "x")]
    mech.add(bd.Controller("digital", every, reads, [force], law, state=[0.0, 0.0], delay=delay))
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(
    ("mech", "t_end"),
    [
        (build_hard_stage(-5e3, 30.0, ki=1e4), 0.3),
        (build_hard_stage(-5e3, 30.0, ki=1e4), 1.0),
        (build_hard_stage(-5e3, 30.0, ki=1e4, limits=(-40.0, 40.0)), 1.0),
        (build_sampled_stage(1e-3, 1e5, 60.0, ki=1e5, limit=50.0, delay=3), 0.3),
    ],
    ids=["sign of kp", "longer", "limits", "delay"],
)
def test_regression_loops_that_depart_within_few_vibrations_have_a_warning(mech, t_end):
    """The command grew by a factor of 200 within two swings, or was at a limit from the start."""
    (sentence,) = loop_warnings(mech, t_end, bd.GeneralizedAlpha(5e-4))
    assert re.match(r"(servo: the command|digital: force) ", sentence)


@pytest.mark.parametrize(
    ("mech", "t_end"),
    [
        (build_hard_stage(5e3, 60.0, ki=1e5), 0.1),
        (build_hard_stage(5e3, 0.5, damping=0.05), 1.0),
        (build_hard_stage(5e3, 0.0, damping=0.0), 1.0),
        (build_hard_stage(5e3, 60.0, ki=1e5, goal=0.05), 0.3),
        (build_hard_stage(5e4, 300.0, goal=5e-3, limits=(-20.0, 20.0)), 0.3),
        (build_hard_stage(0.0, 1.0, ki=1e3), 1.0),
        (build_hard_stage(5e3, 60.0, goal=lambda t: STEP * t**3 * np.sin(30.0 * t)), 1.0),
        (build_hard_stage(5e3, 0.5, goal=bd.sine(STEP, 18.8)), 1.0),
        (build_sampled_stage(1e-3, 5e3, 40.0, ki=1e5), 0.3),
        (build_sampled_stage(1e-3, 2e4, 60.0, limit=10.0, goal=4e-3), 0.3),
        (build_sampled_stage(1e-3, 1e3, 10.0, delay=2), 0.5),
    ],
)
def test_stable_loops_that_do_not_settle_have_no_warning(mech, t_end):
    assert not loop_warnings(mech, t_end, bd.GeneralizedAlpha(5e-4))


@pytest.mark.parametrize("gain", [5.0, 60.0])
def test_equilibria_that_are_unstable_without_the_loop_have_no_warning(gain):
    """A loop cannot destabilize a pendulum that stands upright."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    rod = mech.add(bd.RigidBody("rod", 1.0, 0.03, center=(0.0, 0.3)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    x, v = (mech.sensor(name, rod.at(0.0, 0.3), name) for name in ("angle", "angle_dot"))
    mech.add(bd.Moment("motor", rod.at(0.0, 0.0), bd.pid(mech, "servo", -x, gain, kd=1.0, rate=-v)))
    mech.add(bd.Moment("push", rod.at(0.0, 0.0), bd.sine(0.01, 1.0)))
    assert not [x for x in loop_warnings(mech, 3.0, bd.GeneralizedAlpha(5e-3)) if "mode" in x]


FLEXURE = {"stiffness": 977.78, "masses": (0.2524, 0.1242)}
GAINS = {"kp": 6200.0, "ki": 1.9e5, "kd": 55.0, "filter_time": 5e-4}


def build_two_masses(limit, every=None, delay=0, **factors):
    """Return a platform on a spring, an intermediate body and a spring, with a PID loop.

    Gains are multiplied by `factors`. With `every`, the controller is sampled.
    """
    k, (mass, between) = FLEXURE["stiffness"], FLEXURE["masses"]
    kp, ki, kd, lag = (value * factors.get(name, 1.0) for name, value in GAINS.items())
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("body", between, at=(0.0, 0.0)))
    platform = mech.add(bd.PointMass("platform", mass, at=(1.0, 0.0)))
    foot = mech.ground.at(-1.0, 0.0)
    for name, a, b in (("low", foot, body.point), ("high", body.point, platform.point)):
        mech.add(bd.PointOnLine(f"{name} rail", mech.ground.at(0.0, 0.0), b))
        mech.add(bd.Spring(f"{name} spring", a, b, k))
        mech.add(bd.Damper(f"{name} damper", a, b, 2e-4 * k))
    x = mech.sensor("x", platform.point, "x")
    goal = mech.input("goal", bd.piecewise((0.01, 0.0), 0.5 * STEP), unit="m")
    if every is None:
        gains = {"kp": kp, "ki": ki, "kd": kd, "filter_time": lag, "scale": 1e-5}
        force = bd.pid(mech, "servo", goal - (x - 1.0), **gains, limits=(-limit, limit))
    else:
        force, share = mech.input("force", unit="N"), lag / (lag + every)

        def law(sample):
            goal, x = sample.reads
            integral, rate, last = sample.state
            error = goal - (x - 1.0)
            rate = share * rate + (1.0 - share) * (error - last) / every
            wanted = kp * error + ki * integral + kd * rate
            command = float(np.clip(wanted, -limit, limit))
            sample.state[:] = integral + every * error * (wanted == command), rate, error
            return command

        state = [0.0, 0.0, 0.0]
        mech.add(bd.Controller("servo", every, [goal, x], [force], law, state=state, delay=delay))
    mech.add(bd.Force("coil", platform.point, (force, 0.0)))
    return mech


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_limit_cycles_whose_first_swings_are_the_largest_have_a_warning():
    """The force was at its limits for 84 % of the last quarter of 2 s, without a warning."""
    (sentence,) = loop_warnings(build_two_masses(8.0, ki=8.0), t_end=2.0)
    assert sentence.startswith("servo: the command does not settle, and a mode of the loop")


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("growth", [6.0, 25.0])
def test_regression_loops_that_grow_slowly_have_a_warning(growth):
    """A loop that grew by less than a factor of 30 in the run was silent."""
    mech = build_stage(1.5)
    rate = np.max(bd.linearize(mech).poles.real)
    (sentence,) = loop_warnings(mech, np.log(growth) / rate)
    assert sentence.startswith("servo: the command does not settle, and a mode of the loop")


@pytest.mark.slow(reason="a fifth of a second")
def test_resonances_that_grow_slowly_have_no_warning_of_unstable_loops():
    mech = build_stage(0.9, damping=0.02)
    poles = bd.linearize(mech).poles
    slowest = poles[np.argmax(poles.real)]
    assert slowest.real < 0.0
    frequency = abs(slowest.imag)
    stage = mech.parts["stage"].point
    mech.add(bd.Force("hum", stage, (lambda t: 0.1 * np.sin(frequency * t), 0.0)))
    assert not loop_warnings(mech, 10.0 * 2.0 * np.pi / frequency)


@pytest.mark.slow(reason="96 runs, some of which last 10 s")
@pytest.mark.parametrize("limit", [4.0, 8.0, 30.0])
@pytest.mark.parametrize("factor", [1.0, 2.0, 4.0, 6.0, 8.0, 12.0, 20.0, 40.0])
def test_regression_limit_cycles_have_a_warning_after_all_times(factor, limit):
    """The loop is unstable from 4.4 times the integral gain on, with a rate of 2.2 /s at 6 times.

    Loops that grow by less than a factor of 30 in a run may have a warning.
    """
    for t_end in (2.0, 3.0, 6.0, 10.0):
        found = loop_warnings(build_two_masses(limit, ki=factor), t_end)
        assert len(found) == (factor > 5.0), t_end


@pytest.mark.slow(reason="24 runs of sampled loops of up to 6 s")
@pytest.mark.parametrize(("every", "delay"), [(1e-3, 0), (5e-4, 1)])
@pytest.mark.parametrize("factor", [1.0, 6.0, 8.0, 12.0])
def test_regression_limit_cycles_of_sampled_loops_have_a_warning_after_all_times(
    factor, every, delay
):
    for limit, t_end in ((4.0, 3.0), (4.0, 6.0), (30.0, 1.5)):
        mech = build_two_masses(limit, every, delay, ki=factor)
        found = loop_warnings(mech, t_end, bd.GeneralizedAlpha(5e-4))
        assert len(found) == (factor > 5.0), (limit, t_end)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("size", [1e-12, 1e-7])
def test_regression_growth_far_below_the_command_has_no_warning(size):
    """Rounding errors before a step of the target grew by a factor of 16 000 at random."""
    law = bd.piecewise((0.5, lambda t: size * STEP * np.exp(30.0 * (t - 0.5))), STEP)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*its loop seems to be unstable")
        bd.simulate(build_stage(0.5), bd.Radau(), t_end=0.8, inputs={"target": law})


def build_slow_amplifier(gain, limit=8.0):
    """Return a PID loop of a mass of 0.25 kg on a spring whose amplifier has a lag of 1 ms."""
    mech = bd.Mechanism()
    stage = mech.add(bd.PointMass("stage", 0.25, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), stage.point))
    mech.add(bd.Spring("leaf", mech.ground.at(-1.0, 0.0), stage.point, 211.0))
    error = mech.input("goal", STEP, unit="m") - mech.sensor("x", stage.point, "x")
    gains = {"kp": 7709.0 * gain, "ki": 345600.0 * gain, "kd": 72.0 * gain}
    limits = (-limit, limit)
    force = bd.pid(mech, "servo", error, **gains, filter_time=5e-4, limits=limits, scale=1e-6)
    mech.add(bd.Force("coil", stage.point, (bd.low_pass(mech, "amplifier", force, 1e-3), 0.0)))
    return mech


@pytest.mark.parametrize(("gain", "is_unstable"), [(1.0, False), (10.0, True), (50.0, True)])
@pytest.mark.parametrize("t_end", [0.08, 0.15])
def test_regression_limit_cycles_of_few_swings_have_a_warning(gain, is_unstable, t_end):
    """The first command exceeded the limits by a factor of 200, and hid the swings after it."""
    found = loop_warnings(build_slow_amplifier(gain), t_end)
    assert len(found) == is_unstable
    assert all(x.startswith("servo: the command does not settle") for x in found)


@pytest.mark.parametrize(("every", "is_unstable"), [(1e-3, False), (8e-3, True), (1e-2, True)])
@pytest.mark.parametrize("limit", [10.0, 30.0])
def test_regression_unstable_sampled_loops_of_ten_samples_have_a_warning(every, is_unstable, limit):
    """Commands at their limits in all samples have no gains there, but between them."""
    for t_end in (0.1, 0.15):
        mech = build_sampled_stage(every, 2e4, 60.0, limit=limit)
        assert len(loop_warnings(mech, t_end, bd.GeneralizedAlpha(5e-4))) == is_unstable


def build_shaker(kd, frequency, limit=np.inf, by_index=False, noise=0.0):
    """Return a mass of 1 kg that follows a sine at 1 kHz, unstable from kd = 2000 N s/m on."""
    mech = bd.Mechanism()
    stage = mech.add(bd.PointMass("stage", 1.0, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), stage.point))
    x, v = (mech.sensor(name, stage.point, name) for name in ("x", "x_dot"))
    force = mech.input("force", unit="N")
    mech.add(bd.Force("motor", stage.point, (force, 0.0)))

    def law(sample):
        position, speed = sample.reads
        time = sample.index * sample.every if by_index else sample.t
        goal = STEP * np.sin(2.0 * np.pi * frequency * time)
        goal += noise * sample.random.standard_normal()
        return float(np.clip(4000.0 * (goal - position) - kd * speed, -limit, limit))

    mech.add(bd.Controller("servo", 1e-3, [x, v], [force], law))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "settings",
    [
        {"frequency": 250.0, "by_index": True},
        {"frequency": 300.0, "noise": 1e-2 * STEP},
        {"frequency": 400.0, "limit": 3.0},
    ],
)
def test_regression_commands_that_follow_a_fast_reference_have_no_warning(settings):
    """A command that alternated as the sine in the law was that of an unstable loop."""
    assert not loop_warnings(build_shaker(kd=60.0, **settings), t_end=0.06)


@pytest.mark.parametrize("frequency", [2.0, 300.0])
def test_unstable_loops_with_a_fast_reference_have_a_warning(frequency):
    assert loop_warnings(build_shaker(4000.0, frequency, limit=20.0), t_end=0.06)


@pytest.mark.parametrize("resolution", [1e-8, 1e-7, 1e-6])
@pytest.mark.parametrize(("delay", "is_unstable"), [(0, False), (3, True), (5, True)])
def test_regression_loops_with_encoders_are_linearized(resolution, delay, is_unstable):
    """Short differences of laws that round their readings jump or vanish."""
    gains = {"ki": 1e5, "limit": 20.0, "delay": delay, "resolution": resolution}
    mech = build_sampled_stage(1e-3, 2e4, 60.0, **gains)
    found = loop_warnings(mech, 0.15, bd.GeneralizedAlpha(5e-4))
    assert len(found) == is_unstable


@pytest.mark.parametrize("acts", [True, False])
def test_regression_states_without_effect_belong_to_no_loop(acts):
    """The work of a load in a run with a bad step was called a loop with wrong gains."""
    mech = bd.Mechanism()
    cart = mech.add(bd.PointMass("cart", 1.0, at=(0.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), cart.point))
    growing = mech.state("growing", start=1e-6)
    growing.follows(30.0 * growing)
    integral = mech.state("integral", growing)
    force = integral if acts else mech.input("force", 1.0)
    mech.add(bd.Force("push", cart.point, (force, 0.0)))
    assert len(loop_warnings(mech, 1.0)) == acts


@pytest.mark.parametrize("every", [1e-3, 1e-2])
def test_sampled_relays_have_no_gains(every):
    """The level of a thermostat alternates as it should."""
    mech = build_hard_stage(0.0, 0.0)
    stage = mech.parts["stage"]
    force = mech.input("force", unit="N")
    mech.add(bd.Force("actuator", stage.point, (force, 0.0)))
    reads = [mech.sensor("position", stage.point, "x")]

    def law(sample):
        return 4.0 if sample.reads[0] < STEP else 0.0

    mech.add(bd.Controller("relay", every, reads, [force], law))
    assert not loop_warnings(mech, 0.12, bd.GeneralizedAlpha(5e-4))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize(("steps", "is_named"), [(8, True), (1000, False)])
def test_regression_limit_cycles_of_quantization_have_a_warning(steps, is_named):
    """Commands that did not repeat were silent, with a vibration of half a step of the encoder."""
    gains = {"ki": 3e4, "limit": 20.0, "resolution": STEP / steps}
    mech = build_sampled_stage(1e-3, 4e3, 65.0, **gains)
    run = bd.simulate(mech, bd.GeneralizedAlpha(5e-4), t_end=0.15)
    found = [x for x in run.warnings if x.startswith("digital: ")]
    assert len(found) == is_named
    if is_named:
        assert found[0].startswith("digital: force alternates between ")
        step = float(found[0].split("rounds position in steps of ")[1].split(" m, ")[0])
        assert_allclose(step, STEP / steps, rtol=0.1)
