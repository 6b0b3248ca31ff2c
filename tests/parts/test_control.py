"""Controllers: continuous blocks of states, and sampled laws, against closed forms."""

import re
import warnings

import control
import numpy as np
import pytest
from mechanisms import free_ball, hinged_body, mass_on_rail
from scipy.integrate import solve_ivp
from test_signals import INTEGRATORS

import beamdae as bd

INERTIA = 0.5


def _loop_without_actuator(actuator=None, limits=None, is_sampled=False):
    mech, stage = mass_on_rail(2.0, name="stage")
    x, v = (mech.sensor(name, stage.point, name) for name in ("x", "x_dot"))
    if is_sampled:
        command = mech.input("F", unit="N")
        mech.add(bd.Controller("servo", 0.01, [x], [command], lambda s: -s.reads[0]))
    else:
        command = bd.pid(mech, "servo", 0.1 - x, 300.0, 400.0, 40.0, rate=-v, limits=limits)
    if actuator is not None:
        mech.add(actuator(mech, stage.point, command))
    return bd.equations_of_motion(mech).build_warnings


_ACTUATORS = [
    lambda mech, at, u: bd.Force("motor", at, (1.0 - u, 0.0)),
    lambda mech, at, u: bd.ForceLaw("motor", at, lambda point, t: (u, 0.0)),
    lambda mech, at, u: bd.Force("motor", at, (mech.state("lag", lambda x, t: (u - x) / 1e-3), 0)),
    lambda mech, at, u: bd.Force("motor", at, (bd.pid(mech, "inner", u, 2.0), 0.0)),
]


@pytest.mark.parametrize("settings", [{}, {"limits": (-5.0, 5.0)}, {"is_sampled": True}])
def test_regression_commands_that_no_part_uses_have_a_warning(settings):
    """A loop whose actuator was forgotten ran without a warning."""
    (sentence,) = _loop_without_actuator(**settings)
    assert sentence.startswith("servo: ")
    assert "is used by no part" in sentence
    for actuator in _ACTUATORS:
        assert not _loop_without_actuator(actuator, **settings)


def servo_law(sample):
    angle, rate = sample.reads
    return 8.0 * (1.0 - angle) - 4.0 * rate


def build_servo(law=servo_law, every=0.05, **options):
    """Return a wheel under a moment that a sampled controller sets."""
    mech, wheel = hinged_body(1.0, INERTIA, name="wheel")
    torque = mech.input("torque", unit="N m")
    mech.add(bd.Moment("motor", wheel.at(0.0, 0.0), torque))
    angle = mech.sensor("angle", wheel.at(0.0, 0.0), "angle")
    rate = mech.sensor("rate", wheel.at(0.0, 0.0), "angle_dot")
    mech.add(bd.Controller("servo", every, [angle, rate], [torque], law, **options))
    return mech


def sampled_servo(every, t_end, delay=0, gains=(8.0, 4.0)):
    """Return the exact angles at the samples: the torque is constant between them."""
    angle = rate = 0.0
    waiting, angles = [0.0] * delay, [0.0]
    for _ in range(round(t_end / every)):
        waiting.append(gains[0] * (1.0 - angle) - gains[1] * rate)
        acceleration = waiting.pop(0) / INERTIA
        angle += rate * every + 0.5 * acceleration * every**2
        rate += acceleration * every
        angles.append(angle)
    return np.array(angles)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda x: x.method)
@pytest.mark.parametrize("delay", [0, 2])
def test_sampled_servo(integrator, delay):
    every = 0.05
    run = bd.simulate(build_servo(delay=delay), integrator, t_end=1.0, output_step=every)
    np.testing.assert_allclose(run["angle"], sampled_servo(every, 1.0, delay), atol=2e-8)
    assert run.warnings == ()


def test_intervals_that_are_not_multiples_of_steps():
    every = 0.0371
    run = bd.simulate(build_servo(every=every), bd.GeneralizedAlpha(0.01), t_end=1.0)
    angles = sampled_servo(every, 1.0)
    times = every * np.arange(len(angles))
    found = [run.at(t).state.q[2] for t in times if t <= 1.0]
    np.testing.assert_allclose(found, angles[: len(found)], atol=1e-9)


@pytest.mark.slow(reason="three runs with a restart at each sample")
def test_discrete_state_and_resumed_runs():
    def law(sample):
        angle, _ = sample.reads
        sample.state[0] += sample.every * (1.0 - angle)
        return sample.state[0]

    whole = bd.simulate(build_servo(law, state=[0.5]), bd.Radau(1e-9), t_end=1.0, output_step=0.05)
    first = bd.simulate(build_servo(law, state=[0.5]), bd.Radau(1e-9), t_end=0.4, output_step=0.05)
    rest = bd.simulate(
        build_servo(law, state=[0.5]), bd.Radau(1e-9), 1.0, start=first, accept_changes=True
    )
    assert rest["angle"].iloc[-1] == pytest.approx(whole["angle"].iloc[-1], rel=1e-9)
    names = whole.equations.q_names
    state = whole.at(1.0).state.q[names.index("servo.state1")]
    expected = 0.5 + 0.05 * np.sum(1.0 - whole["angle"].iloc[:-1])
    assert state == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow(reason="three runs with a restart at each sample")
def test_noise_is_repeated_and_quantization_acts():
    def law(sample):
        angle, rate = np.round(sample.reads + 1e-3 * sample.random.normal(size=2), 2)
        return 8.0 * (1.0 - angle) - 4.0 * rate

    runs = [
        bd.simulate(build_servo(law, seed=seed), bd.Radau(), t_end=1.0)["angle"].to_numpy()
        for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert np.max(np.abs(runs[0] - runs[2])) > 1e-5


@pytest.mark.parametrize(
    ("law", "reason"),
    [
        (lambda sample: 1.0 / 0.0, "the law failed at t = 0 s: ZeroDivisionError"),
        (lambda sample: setattr(sample, "state", "abc") or 0.0, "the state must consist of"),
        (lambda sample: np.nan, "must return one finite number"),
        (lambda sample: [1.0, 2.0], "must return one finite number per driven input"),
        (lambda sample: None, "got None"),
        (lambda sample: -1e308, "at most 1e.75 in absolute value, got -1e.308"),
        (lambda sample: sample.state.__setitem__(0, 1e80) or 0.0, "the state must consist of"),
    ],
    ids=["raises", "state", "nan", "two numbers", "nothing", "huge", "huge state"],
)
def test_failing_law_ends_the_run_with_a_reason(law, reason):
    """A run whose first sample fails cannot begin; it keeps the steps before a later one."""
    with pytest.raises(bd.BeamdaeError, match=reason):
        bd.simulate(build_servo(law, state=[0.0]), bd.Radau(), t_end=1.0)
    later = lambda sample: law(sample) if sample.index else 0.0  # noqa: E731
    reason = reason.replace("t = 0 s", "t = 0.05 s")
    with pytest.warns(bd.BeamdaeWarning, match=reason):
        run = bd.simulate(build_servo(later, state=[0.0]), bd.Radau(), t_end=1.0)
    assert run.status.kind == "failed"
    assert run.t[-1] == pytest.approx(0.05)


def build_notch_servo(rate, target, load=0.0):
    """Return a stage with a notch filter and a PID controller, and the two polynomials."""
    mech, stage = mass_on_rail(2.0, name="stage")
    x, v = (mech.sensor(name, stage.point, name) for name in ("x", "x_dot"))
    notch = np.polymul([1.0, 0.1 * rate, rate**2], [1.0, 0.2 * rate, 4.0 * rate**2])
    poles = np.polymul([1.0, 1.4 * rate, rate**2], [1.0, 2.8 * rate, 4.0 * rate**2])
    error = bd.transfer_function(mech, "notch", mech.input("target", target) - x, notch, poles)
    force = bd.pid(mech, "servo", error, kp=6.0, ki=4.0, kd=3.0, rate=-v)
    mech.add(bd.Force("motor", stage.point, (force - load, 0.0)))
    return mech, notch, poles


@pytest.mark.parametrize("rate", [1.0, 50.0, 200.0, 2e3, 1e4])
def test_regression_equilibria_of_loops_with_fast_filters_are_found(rate):
    """Rounding of states was relative to their scale, of which filters reach a tiny fraction."""
    mech, *_ = build_notch_servo(rate, 0.1, load=1.5)
    found = bd.equilibrium(mech)
    assert found["x"].iloc[-1] == pytest.approx(0.1, rel=1e-9)
    assert found["servo integral"].iloc[-1] == pytest.approx(1.5 / 4.0, rel=1e-9)


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("rate", [5.0, 200.0, 2e3, 1e4])
def test_regression_periodic_motions_of_loops_with_fast_filters_are_found(rate):
    """States of filters are far below their scale: multipliers of 4.1 for 0.33, or no motion."""
    mech, notch, poles = build_notch_servo(rate, bd.sine(0.1, 0.5))
    motion = bd.periodic(mech, 2.0)
    s = 1j * np.pi
    controller = (6.0 + 4.0 / s) * np.polyval(notch, s) / np.polyval(poles, s)
    exact = 0.1 * abs(controller / (2.0 * s**2 + 3.0 * s + controller))
    half_range = motion.amplitudes().loc["x [m]", "half range"]
    assert half_range == pytest.approx(exact, rel=1e-6)


def test_regression_noise_of_several_controllers_is_independent():
    """Controllers with the default seed received the same random numbers."""
    mech = build_servo(lambda sample: sample.random.normal())
    others = [mech.input(name) for name in ("second", "third")]
    for k, value in enumerate(others):
        mech.add(bd.Controller(f"noise {k}", 0.05, [], [value], lambda x: x.random.normal()))
    run = bd.simulate(mech, bd.GeneralizedAlpha(0.01), t_end=20.0, output_step=0.05)
    noise = np.corrcoef([run[name][1:] for name in ("torque", "second", "third")])
    # Four standard deviations of the coefficients of 400 independent pairs.
    assert np.abs(noise - np.eye(3)).max() < 4.0 / np.sqrt(400.0)


@pytest.mark.parametrize("method", [bd.Radau(), bd.Ida(), bd.GeneralizedAlpha(5e-3)])
def test_regression_unstable_loops_are_named_where_runs_stop(method):
    """Extreme loads, the acceleration of a part or the return value of the law was blamed."""

    def unstable(sample):
        return 1e5 * (sample.reads[0] - 1.0) * (1.0 + 1e-3 * sample.index)

    with pytest.warns(bd.BeamdaeWarning):
        run = bd.simulate(build_servo(unstable), method, t_end=5.0)
    assert not run.status.success
    assert re.search(r"servo has changed torque from -1e\+05 N m to .*e\+", run.status.sentence)
    assert "check the signs and sizes of its gains, and every=; " in run.status.sentence


def test_regression_stable_loops_are_not_called_unstable_where_a_limit_stops_the_run():
    """A set point that leaves zero was called growth from 3e-15 N m."""

    def stable(sample):
        target = 3e-15 if sample.t < 0.1 else 0.3
        return 6.0 * (target - sample.reads[0]) - 1.2 * sample.reads[1]

    with pytest.warns(bd.BeamdaeWarning):
        run = bd.simulate(build_servo(stable), bd.Radau(max_steps=60), t_end=5.0)
    assert run.status.kind == "limited"
    assert "unstable" not in run.status.sentence


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_commands_are_no_vibrations_of_the_drawing():
    """The derivative of the first samples was "because the drawing is not in equilibrium"."""
    mass, stiffness, kp, ki, kd, every = 0.8, 15e3, 20e3, 8e5, 2000.0, 5e-4

    def pid(sample):
        (position,) = sample.reads
        integral, last = sample.state
        error = 5e-4 - position
        sample.state[:] = integral + every * error, position
        return kp * error + ki * integral - kd * (position - last) / every

    mech, stage = mass_on_rail(mass, name="stage")
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), stage.point, stiffness))
    force = mech.input("force", unit="N")
    mech.add(bd.Force("actuator", stage.point, (force, 0.0)))
    position = mech.sensor("position", stage.point, "x")
    mech.add(bd.Controller("servo", every, [position], [force], pid, state=[0.0, 0.0]))
    run = bd.simulate(mech, bd.GeneralizedAlpha(1e-4), t_end=0.15)
    assert run["force"].iloc[:20].min() < -4.0
    assert run["force"].iloc[30:].min() > -1.0
    assert run.warnings == ()


def test_regression_laws_with_memory_of_their_own_end_the_run():
    # Pilot runs call the law, too: the second of two equal runs gave another result in silence.
    integral, previous = [0.0], [0.0]

    def integrate(sample):
        integral[0] += sample.every * (1.0 - sample.reads[0])
        return 8.0 * integral[0] - 4.0 * sample.reads[1]

    def differentiate(sample):
        rate = (sample.reads[0] - previous[0]) / sample.every
        previous[0] = sample.reads[0]
        return 8.0 * (1.0 - sample.reads[0]) - 4.0 * rate

    generator = np.random.default_rng(1)
    message = r"the law gave .*, then .* for the same sample at t = {} s; keep memory in sam"
    with pytest.warns(bd.BeamdaeWarning, match=message.format(r"0\.05")):
        run = bd.simulate(build_servo(differentiate), bd.GeneralizedAlpha(0.01), t_end=1.0)
    assert run.status.kind == "failed"
    # A run whose first sample fails cannot begin.
    for law in (integrate, lambda sample: generator.normal()):
        with pytest.raises(bd.BeamdaeError, match=message.format("0")):
            bd.simulate(build_servo(law), bd.GeneralizedAlpha(0.01), t_end=1.0)


@pytest.mark.parametrize("method", [bd.Radau(), bd.Ida(), bd.GeneralizedAlpha(5e-3)])
@pytest.mark.parametrize("start", [0.0, 0.4], ids=["from rest", "resumed"])
def test_regression_laws_whose_memory_acts_late_end_the_run(method, start):
    """A latch that the pilot run had closed was closed from the start, without a warning."""
    is_closed = False

    def latch(sample):
        nonlocal is_closed
        is_closed = is_closed or sample.t > start + 0.25
        return 2.0 * is_closed - sample.reads[1]

    def count(sample):
        nonlocal calls
        calls += 1
        return 2.0 * (calls % 20 > 12) - sample.reads[1]

    begin = {}
    if start:
        begin["start"] = bd.simulate(build_servo(lambda sample: -sample.reads[1]), method, start)
    for law in (latch, count):
        calls, is_closed = 0, False
        with pytest.warns(bd.BeamdaeWarning, match="for the same sample at t = .*; keep memory in"):
            run = bd.simulate(build_servo(law), method, start + 0.5, **begin)
        assert run.status.kind == "failed"


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_laws_whose_memory_an_earlier_run_has_changed_end_later_runs():
    """The second run was "ok", with a latch that was closed from its start."""
    is_closed = False

    def latch(sample):
        nonlocal is_closed
        is_closed = is_closed or sample.t > 0.25
        return 2.0 * is_closed - sample.reads[1]

    message = "the law gave 0, then 2 for the same sample"
    with pytest.warns(bd.BeamdaeWarning, match=f"servo: {message}"):
        run = bd.simulate(build_servo(latch), bd.GeneralizedAlpha(5e-3), 0.5)
    assert run.status.kind == "failed"
    with pytest.raises(bd.BeamdaeError, match=f"servo: in an earlier run, {message}"):
        bd.simulate(build_servo(latch), bd.GeneralizedAlpha(5e-3), 0.5)
    is_closed = False
    law = lambda sample: latch(sample)  # noqa: E731
    assert bd.simulate(build_servo(law), bd.GeneralizedAlpha(5e-3), 0.2).status.success


def test_analyses_other_than_runs_reject_sampled_controllers():
    for analysis in (bd.linearize, bd.modes, bd.equilibrium):
        with pytest.raises(bd.BeamdaeError, match="controller 'servo' is called only in runs") as e:
            analysis(build_servo())
        assert "bd.linearize(plant).state_space(every)" in str(e.value)
    check = bd.check(build_servo())
    assert check.ok
    assert "inertia" not in str(check)


@pytest.mark.slow(reason="a fifth of a second")
def test_step_response_of_a_transfer_function():
    mech = bd.Mechanism()
    step = mech.input("step", default=1.0)
    output = bd.transfer_function(mech, "filter", step, [0.5, 1.0, 8.0], [1.0, 2.0, 9.0])
    mech.state("lag", lambda lag, t: (output - lag) / 0.3)
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=3.0, output_step=0.1)
    plant = control.tf([0.5, 1.0, 8.0], [1.0, 2.0, 9.0]) * control.tf([1.0], [0.3, 1.0])
    expected = control.step_response(plant, run.t).outputs
    np.testing.assert_allclose(run["lag"], expected, atol=1e-7)


def build_stage(goal=0.1, kp=300.0, **options):
    """Return a mass on a rail under a PID controller."""
    mech, stage = mass_on_rail(2.0, name="stage")
    x = mech.sensor("x", stage.point, "x")
    force = bd.pid(mech, "servo", goal - x, kp=kp, ki=400.0, kd=40.0, **options)
    mech.add(bd.Force("motor", stage.point, (force, 0.0)))
    return mech


@pytest.mark.slow(reason="half a second")
def test_step_response_of_a_pid():
    run = bd.simulate(build_stage(filter_time=0.01), bd.Radau(1e-9), t_end=2.0, output_step=0.05)
    s = control.tf("s")
    loop = (300.0 + 400.0 / s + 40.0 * s / (0.01 * s + 1.0)) / (2.0 * s**2)
    response = control.step_response(control.feedback(loop), run.t).outputs
    np.testing.assert_allclose(run["x"], 0.1 * response, atol=1e-7)


@pytest.mark.slow(reason="two runs with kinks, and a fine reference")
def test_saturated_pid_does_not_wind_up():
    limits = {"filter_time": 0.01, "limits": (-1.0, 1.0)}
    run = bd.simulate(build_stage(**limits), bd.Radau(1e-8), t_end=4.0, output_step=0.05)

    def rate(t, s):
        x, v, integral, filtered = s
        error = 0.1 - x
        raw = 300.0 * error + 400.0 * integral + 40.0 * (error - filtered) / 0.01
        force = np.clip(raw, -1.0, 1.0)
        return [v, force / 2.0, error + (force - raw) / 300.0, (error - filtered) / 0.01]

    options = {"rtol": 1e-9, "atol": 1e-12, "max_step": 1e-2, "t_eval": run.t}
    expected = solve_ivp(rate, (0.0, 4.0), np.zeros(4), **options)
    np.testing.assert_allclose(run["x"], expected.y[0], atol=2e-6)
    # Without tracking, the integral winds up and the stage overshoots more than twice as far.
    winding = bd.simulate(build_stage(**limits, tracking_time=1e9), bd.Radau(), t_end=4.0)
    assert np.max(winding["x"]) - 0.1 > 2.0 * (np.max(run["x"]) - 0.1)


class _UnreadableList(list):
    def __iter__(self):
        raise RuntimeError("this list raises")


def nest_list(depth):
    nested = []
    for _ in range(depth):
        nested = [nested]
    return nested


@pytest.mark.parametrize("unit", [nest_list(1000), _UnreadableList(), "m\x1b", "\ud800", "deg", 3])
def test_invalid_units_are_rejected_at_once(unit):
    mech = bd.Mechanism()
    for add in (
        lambda: mech.state("lag", unit=unit),
        lambda: mech.input("lag", unit=unit),
    ):
        with pytest.raises(bd.BeamdaeError, match=r"lag: (units|angles) must be"):
            add()
    assert "lag" not in mech.parts
    assert "lag" not in mech.inputs


def test_regression_blocks_with_a_name_in_use_leave_no_states():
    mech = bd.Mechanism()
    signal = mech.input("signal")
    for name in ("lead 2", "servo integral"):
        mech.state(name, signal)
    before = list(mech.parts), list(mech.observables)
    with pytest.raises(bd.BeamdaeError, match="the name 'lead 2' is in use"):
        bd.transfer_function(mech, "lead", signal, [1.0], [1.0, 2.0, 3.0])
    with pytest.raises(bd.BeamdaeError, match="the name 'servo integral' is in use"):
        bd.pid(mech, "servo", signal, 1.0, ki=1.0, kd=1.0, filter_time=0.1)
    assert (list(mech.parts), list(mech.observables)) == before


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (lambda x, goal, push: 0.1 - x, None, ("m", "m s", "m s^2", "m s")),
        (lambda x, goal, push: push - x, None, ("-", "-", "-", "-")),
        (lambda x, goal, push: goal - 2.0 * x, "rad/s", ("rad/s", "rad", "rad s", "rad")),
        (lambda x, goal, push: goal, "-", ("-", "s", "s^2", "s")),
        (lambda x, goal, push: goal, "1/s", ("1/s", "-", "s", "-")),
    ],
)
def test_states_of_blocks_have_the_units_of_their_formulas(value, unit, expected):
    mech, ball = free_ball()
    x = mech.sensor("x", ball.point, "x")
    value = value(x, mech.input("goal"), mech.input("push", unit="N"))
    settings = {} if unit is None else {"unit": unit}
    bd.pid(mech, "servo", value, 1.0, ki=1.0, kd=1.0, filter_time=0.1, **settings)
    bd.transfer_function(mech, "block", value, [1.0], [1.0, 1.0, 1.0], **settings)
    names = ("servo filter", "servo integral", "block 1", "block 2")
    assert tuple(mech.part(name).unit for name in names) == expected


def test_regression_integrals_of_quotients_have_their_unit():
    mech = bd.Mechanism()
    signal = mech.input("signal")
    expected = {"m/s^2": "m/s", "N/m": "N s/m", "1/s^2": "1/s", "rad s": "rad s^2", "1/m": "s/m"}
    for number, unit in enumerate(expected):
        bd.pid(mech, f"pid {number}", signal, 1.0, ki=1.0, unit=unit)
    units = [mech.part(f"pid {number} integral").unit for number in range(len(expected))]
    assert units == list(expected.values())


# Commands of controllers at their limits, where there is no feedback.

LIMIT = 5.0


def limited_stage(target, limits=(-LIMIT, LIMIT), ki=4.0, size=1.0):
    """Return a mass on a spring whose force is limited by `pid`."""
    mech, stage = mass_on_rail(2.0, name="stage")
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), stage.point, 20.0 * size))
    x, v = (mech.sensor(name, stage.point, name) for name in ("x", "x_dot"))
    gains = {"kp": 6.0 * size, "ki": ki * size, "kd": 3.0 * size}
    error, limits = mech.input("target", target) - x, tuple(size * x for x in limits)
    force = bd.pid(mech, "servo", error, **gains, rate=-v, limits=limits)
    mech.add(bd.Force("motor", stage.point, (force, 0.0)))
    return mech


def limit_sentences(analysis, *arguments, **options):
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        analysis(*arguments, **options)
    return [str(x.message) for x in issued if "its limit" in str(x.message)]


@pytest.mark.parametrize("size", [0.1, 1.0, 1e3])
@pytest.mark.parametrize("target", [2.0, -2.0, 0.05])
@pytest.mark.parametrize("ki", [4.0, 0.0])
def test_regression_saturated_loops_have_no_feedback_in_silence(target, size, ki):
    """Poles were those of the open loop, without a word."""
    model = limited_stage(target, size=size, ki=ki)
    sign = -1 if target < 0.0 else 1
    beyond = f"is beyond its limit {sign * LIMIT * size:.4g}, so "
    for analysis in (bd.linearize, bd.modes):
        sentences = limit_sentences(analysis, model)
        assert len(sentences) == (abs(target) > 1.0)
        for sentence in sentences:
            assert sentence.startswith(f"servo: the command {6.0 * size * target:.4g} {beyond}")
            assert "contains no feedback through it" in sentence
    sentences = limit_sentences(bd.equilibrium, model)
    assert len(sentences) == (abs(target) > 1.0)
    assert all(f"{beyond}this equilibrium is that of the limit" in x for x in sentences)


@pytest.mark.slow(reason="a fifth of a second")
def test_linear_models_at_a_limit_contain_half_of_the_feedback():
    model = limited_stage(0.0, limits=(0.0, LIMIT), ki=0.0)
    (sentence,) = limit_sentences(bd.linearize, model)
    assert sentence.startswith("servo: the command 0 is at its limit, so the linear model contains")
    assert not limit_sentences(bd.equilibrium, model)
    with pytest.warns(bd.BeamdaeWarning, match="half of the feedback"):
        linear = bd.linearize(model)
    # x'' = -(20 + 6 / 2) x / 2 - (3 / 2) x' / 2
    assert sum(linear.poles).real == pytest.approx(-0.75)
    assert abs(linear.poles[0]) ** 2 == pytest.approx(11.5)
