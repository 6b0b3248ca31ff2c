"""Inputs, sensors and first-order states, in all integrators and analyses."""

import math
import warnings

import numpy as np
import pytest
from mechanisms import free_ball, hinged_body, mass_on_rail
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import beamdae as bd

INERTIA, T_END = 0.5, 1.0


def build_wheel():
    """Return a mechanism with a wheel on a pin, and the wheel."""
    mech, wheel = hinged_body(mass=1.0, inertia=INERTIA, name="wheel")
    mech.observe("wheel", wheel.at(0.0, 0.0))
    return mech, wheel


@pytest.fixture
def driven():
    """Return a wheel under a moment of 2 N m that is an input, braked in proportion to its rate."""
    mech, wheel = build_wheel()
    torque = mech.input("torque", default=2.0, unit="N m")
    rate = mech.sensor("rate", wheel.at(0.0, 0.0), "angle_dot")
    mech.add(bd.Moment("motor", wheel.at(0.0, 0.0), torque - 0.25 * rate))
    return mech


@pytest.mark.parametrize(
    "integrator", [bd.Ida(), bd.Radau(), bd.GeneralizedAlpha(1e-3)], ids=lambda x: x.method
)
def test_input_and_sensor_act_in_a_law(driven, integrator):
    run = bd.simulate(driven, integrator, t_end=T_END)
    expected = 8.0 * (1.0 - np.exp(-0.5 * T_END))
    assert run["wheel.angle_dot"].iloc[-1] == pytest.approx(expected, rel=1e-5)
    np.testing.assert_array_equal(run["rate"], run["wheel.angle_dot"])
    np.testing.assert_array_equal(run["torque"], 2.0)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (3.0, 12.0 * (1.0 - np.exp(-0.5))),
        (bd.piecewise((0.5, 2.0), 0.0), 8.0 * (np.exp(-0.25) - np.exp(-0.5))),
        # x' + x/2 = 4 t
        (lambda t: 2.0 * t, 8.0 - 16.0 * (1.0 - np.exp(-0.5))),
    ],
    ids=["number", "piecewise", "function"],
)
def test_run_replaces_the_value_of_an_input(driven, value, expected):
    run = bd.simulate(driven, bd.Radau(rtol=1e-9), t_end=T_END, inputs={"torque": value})
    assert run["wheel.angle_dot"].iloc[-1] == pytest.approx(expected, rel=1e-8)
    assert bd.simulate(driven, bd.Radau(), t_end=T_END)["torque"].iloc[0] == 2.0


def test_formula_of_sensors_is_observed():
    mech, ball = free_ball(velocity=(3.0, 4.0))
    vx, vy = (mech.sensor(x, ball.point, x) for x in ("x_dot", "y_dot"))
    mech.observe("speed", np.hypot(vx, vy), unit="m/s")
    mech.observe("sum", vx + vy)
    passing = mech.when("speed", 4.0, "down", name="slow")
    mech.add(bd.ForceLaw("brake", ball.point, lambda p, t: -p.velocity, dissipative=True))
    run = bd.simulate(mech, bd.Radau(), t_end=1.0)
    assert set(run.observed) >= {"speed [m/s]", "sum [m/s]"}
    np.testing.assert_allclose(run["speed"], 5.0 * np.exp(-run.t), rtol=1e-5)
    assert run.events["t [s]"].iloc[0] == pytest.approx(np.log(1.25), rel=1e-5)
    assert passing.name == "slow"


def test_formula_of_sensors_of_another_mechanism_is_refused():
    mech, wheel = build_wheel()
    rate = mech.sensor("rate", wheel.at(0.0, 0.0), "angle_dot")
    other, _ = build_wheel()
    other.observe("twice", 2.0 * rate)
    with pytest.raises(bd.BeamdaeError, match=r"^twice: 'wheel' is not part of this mechanism"):
        bd.simulate(other, t_end=0.1)
    with pytest.raises(bd.BeamdaeError, match=r"^hub: unit is that of a formula"):
        mech.observe("hub", wheel.at(0.0, 0.0), unit="m")


@pytest.mark.parametrize(
    "formula",
    [
        *(np.sin, np.sqrt, abs, lambda x: np.maximum(x, 0.0), lambda x: np.tanh(x / 0.1)),
        *(lambda x: x % 2.0, lambda x: np.clip(x, 0.0, 1.0), lambda x: np.maximum(x, x**2)),
        lambda x: (np.array([1.0, 2.0]) * x) @ np.array([x, 3.0]),
    ],
)
def test_formulas_outside_laws_have_the_values_of_numbers(formula, recwarn):
    mech, _ = build_wheel()
    angle = mech.input("angle", 0.7)
    for name, argument in (("signal", angle), ("expression", 1.0 * angle)):
        mech.observe(name, formula(argument))
    run = bd.simulate(mech, bd.Radau(), t_end=0.1)
    np.testing.assert_allclose(run[["signal", "expression"]], formula(0.7), rtol=1e-15)
    assert not recwarn.list


@pytest.mark.parametrize(
    ("formula", "sentence"),
    [
        (lambda x: 1.0 if x > 0 else 2.0, r"without branches on \(0<x\) \(if, .*np.maximum"),
        (lambda x: max(x, 0.0), "without branches on"),
        (lambda x: x or 1.0, "without branches on x"),
        (lambda x: 1.0 if 2 * x == 1.0 else 2.0, "without branches on"),
        (math.sin, "without conversions of x to a number .* np.sin"),
        (lambda x: math.sin(2 * x), r"without conversions of \(2.\*x\) to a number"),
        (int, "without conversions of x"),
        (round, "without conversions of x"),
    ],
)
def test_branches_and_numbers_of_signals_end_in_a_sentence(formula, sentence):
    mech, wheel = build_wheel()
    x = mech.input("x", 0.3)
    with pytest.raises(bd.BeamdaeError, match=f"^formula: it must be written {sentence}"):
        formula(x)
    calls = {
        "hub: the law must be a formula in t": lambda: bd.Moment(
            "hub", wheel.at(0.0, 0.0), lambda t: formula(x)
        ),
        "lag: the law must be a formula in t": lambda: mech.state("lag", lambda y, t: formula(x)),
        "pull: law must be a formula": lambda: bd.ForceLaw(
            "pull", wheel.at(0.0, 0.0), lambda p, t: (formula(x), 0.0)
        ),
    }
    for start, call in calls.items():
        with pytest.raises(bd.BeamdaeError, match=f"^{start} {sentence}"):
            call()


def test_signals_act_in_force_laws_springs_and_drivers():
    mech, wheel = build_wheel()
    gain = mech.input("gain", default=3.0, unit="N/m")
    level = mech.input("level", default=0.5, unit="rad")

    def push(point, t):
        return (0.0 * gain, -gain * point.position[1] * np.maximum(level, 0.0))

    mech.add(bd.ForceLaw("push", wheel.at(1.0, 0.0), push))
    mech.add(bd.Driver("driver", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0), level))
    mech.observe("driver", mech.parts["driver"].reaction)
    run = bd.simulate(mech, bd.Radau(), t_end=0.1)
    assert run["wheel.angle"].iloc[-1] == pytest.approx(0.5, rel=1e-12)
    expected = 3.0 * 0.5 * np.sin(0.5) * np.cos(0.5)
    assert run["driver.M"].iloc[-1] == pytest.approx(expected, rel=1e-9)


def test_sensor_measures_a_force_that_contains_an_input():
    mech, wheel = build_wheel()
    torque = mech.input("torque", default=2.0, unit="N m")
    point = wheel.at(0.0, 0.0)
    motor = mech.add(bd.ForceLaw("motor", point, lambda a, t: (0.0, 0.0, torque - a.rate)))
    load = mech.sensor("load", motor.load, "M")
    mech.add(bd.Moment("brake", point, -0.5 * load))
    # 0.5 w' = (2 - w) / 2
    run = bd.simulate(mech, bd.Radau(rtol=1e-9), t_end=T_END)
    assert run["load"].iloc[-1] == pytest.approx(2.0 * np.exp(-1.0), rel=1e-8)


def test_sensor_of_its_own_force_is_rejected():
    mech, wheel = build_wheel()
    holder = []
    law = bd.ForceLaw("motor", wheel.at(0.0, 0.0), lambda a, t: (0.0, 0.0, -sum(holder)))
    mech.add(law)
    holder.append(mech.sensor("load", law.load, "M"))
    with pytest.raises(bd.BeamdaeError, match="load: the sensor measures a force that depends on"):
        bd.equations_of_motion(mech)


def test_constraint_with_a_sensor_is_rejected():
    mech, wheel = build_wheel()
    slide = mech.add(bd.PointMass("slide", 1.0, at=(1.0, 0.0)))
    x = mech.sensor("x", slide.point, "x")
    mech.add(bd.Driver("driver", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0), x))
    with pytest.raises(bd.BeamdaeError, match="driver: a constraint must not depend on the state"):
        bd.equations_of_motion(mech)


def test_inputs_of_linear_models_are_exact(driven):
    linear = bd.linearize(driven, inputs=["torque"])
    assert [x.header for x in linear.inputs] == ["torque [N m]"]
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [0.0, -0.25 / INERTIA]], atol=1e-15)
    np.testing.assert_allclose(linear.B, [[0.0], [1.0 / INERTIA]], atol=1e-15)
    outputs = [x.name for x in linear.outputs]
    assert linear.D[outputs.index("torque"), 0] == 1.0
    assert linear.C[outputs.index("rate")].tolist() == [0.0, 1.0]


def test_input_of_a_driver_is_linearized_as_its_law():
    mech, wheel = build_wheel()
    level = mech.input("level", default=0.2, unit="rad")
    mech.add(bd.Driver("driver", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0), level))
    by_input = bd.linearize(mech, inputs=["level"])
    by_law = bd.linearize(mech, inputs=["driver"])
    assert by_input.inputs[0].header == "level_ddot [rad/s^2]"
    row = [x.name for x in by_input.outputs].index("level")
    np.testing.assert_allclose(by_input.C[row], [1.0, 0.0], atol=1e-12)
    for one, other in zip(by_input, by_law, strict=True):
        if one.shape == by_input.C.shape:
            # Unless it is an input, the law of the driver is constant.
            one, other = np.delete(one, row, axis=0), np.delete(other, row, axis=0)
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_power_of_a_driver_that_follows_an_input():
    mech, wheel = build_wheel()
    level = mech.input("level", unit="rad")
    points = mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)
    driver = mech.add(bd.Driver("driver", *points, level))
    mech.observe("driver", driver.drive)
    run = bd.simulate(mech, bd.Radau(), t_end=1.0, inputs={"level": lambda t: 0.5 * t**3})
    # Moment J 3 t, rate 1.5 t^2.
    assert run["driver.M"].iloc[-1] == pytest.approx(3.0 * INERTIA, rel=1e-6)
    assert run["driver.power"].iloc[-1] == pytest.approx(4.5 * INERTIA, rel=1e-6)


def build_table_spring(moment=0.5, outside="hold", axis=(-0.2, 0.0, 0.2)):
    """Return a wheel with a moment that is a number plus a table of the angle, -3 N m/rad."""
    mech, wheel = build_wheel()
    angle = mech.sensor("angle", wheel.at(0.0, 0.0), "angle")
    # Nothing but the law refers to the table.
    spring = bd.table(axis, [-3.0 * x for x in axis], kind="linear", outside=outside)(angle)
    mech.add(bd.Moment("motor", wheel.at(0.0, 0.0), moment + spring))
    return mech


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_sensors_outside_a_table_are_reported():
    """Runs held the last value of the table without a warning."""
    message = r"motor: x = .* leaves the range -0.2 to 0.2 of table"
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.simulate(build_table_spring(), bd.Radau(), t_end=1.0)
    with pytest.warns(bd.BeamdaeWarning, match=f"stopped at .* {message}"):
        run = bd.simulate(build_table_spring(outside="error"), bd.Radau(), t_end=1.0)
    # 0.2 = 0.5 / 3 (1 - cos(w t))
    end = np.arccos(-0.2) / np.sqrt(3.0 / INERTIA)
    assert run.trajectory.end == pytest.approx(end, rel=1e-4)


@pytest.mark.filterwarnings("error")
def test_sensors_inside_a_table_have_no_warning():
    run = bd.simulate(build_table_spring(moment=0.2), bd.Radau(rtol=1e-8), t_end=T_END)
    expected = 0.2 / 3.0 * (1.0 - np.cos(np.sqrt(3.0 / INERTIA) * T_END))
    assert run["angle"].iloc[-1] == pytest.approx(expected, rel=1e-7)


def test_regression_tables_of_sensors_are_linearized():
    """The value of the law was nan: "motor: law must be finite"."""
    model = bd.linearize(build_table_spring(moment=0.0, axis=(-0.3, -0.1, 0.2)))
    np.testing.assert_allclose(np.abs(model.poles), np.sqrt(3.0 / INERTIA), rtol=1e-9)


def test_regression_sensors_of_reactions_name_the_work_of_drivers():
    """The error did not say where the work of a motor is found."""
    mech, wheel = build_wheel()
    motor = mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0), 0.0))
    with pytest.raises(
        bd.BeamdaeError, match=r"reaction of a joint.*energy\.work_of_drivers \[J\]"
    ):
        mech.sensor("power", motor.drive, "power")


def test_functions_of_arrays_of_signals_are_formulas():
    mech, ball = free_ball(velocity=(3.0, 4.0))
    v = np.array([mech.sensor(x, ball.point, x) for x in ("x_dot", "y_dot")])
    mech.observe("speed", np.sqrt(v @ v), unit="m/s")
    mech.observe("roots", np.sqrt(v)[1])
    mech.state("lag", lambda lag, t: np.sin(np.array([lag, 2.0 * lag]))[0], start=0.5)
    run = bd.simulate(mech, bd.Radau(1e-6), t_end=0.1)
    seen = run.observe("twice", 2.0 * v[0], unit="m/s")
    assert_allclose([run[x].iloc[-1] for x in ("speed", "roots")], [5.0, 2.0], rtol=1e-12)
    assert_allclose(seen["twice [m/s]"].iloc[-1], 6.0, rtol=1e-12)
    # tan(x / 2) grows by e^t.
    expected = 2.0 * np.arctan(np.tan(0.25) * np.exp(0.1))
    assert_allclose(run["lag"].iloc[-1], expected, rtol=1e-6)
    with pytest.raises(bd.BeamdaeError, match=r"numbers, which do not include add of None\.$"):
        v[0] + None


# First-order states against closed forms, in all integrators and analyses.

INTEGRATORS = (bd.Ida(1e-8), bd.Radau(1e-8), bd.GeneralizedAlpha(1e-3))
# The fixed steps of generalized-alpha are accurate to h^2 times a constant of order one.
TOLERANCE = 2e-6

KP, KI, KD, MASS, TARGET = 30.0, 20.0, 8.0, 2.0, 0.3


@bd.model(t_end=2.0)
def pid_stage(kp=KP, ki=KI, kd=KD, mass=MASS, target=TARGET, start=0.0):
    """Mass on a line under a PID controller."""
    mech, stage = mass_on_rail(mass, name="stage")
    x, v = mech.sensor("x", stage.point, "x"), mech.sensor("v", stage.point, "x_dot")
    goal = mech.input("target", target, "m")
    integral = mech.state("integral", goal - x, start=start, unit="m s")
    mech.add(bd.Force("act", stage.point, (kp * (goal - x) + ki * integral - kd * v, 0.0)))
    return mech


def build_lag(rate=2.0, scale=1.0, size=1.0, **settings):
    """Return a mechanism with a ball at 1 m/s and a state that lags its position by 1 / `rate`."""
    mech, ball = free_ball(velocity=(1.0, 0.0))
    x = mech.sensor("x", ball.point, "x")
    mech.state("lag", lambda lag, t: (size * x - lag) * rate, scale=scale, **settings)
    return mech


def lag_of(t, rate=2.0):
    return t - (1.0 - np.exp(-rate * t)) / rate


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda x: x.method)
@pytest.mark.parametrize("rate", [0.2, 2.0, 200.0])
def test_first_order_lag(integrator, rate):
    run = bd.simulate(build_lag(rate), integrator, t_end=2.0, output_step=0.1)
    np.testing.assert_allclose(run["lag"], lag_of(run.t, rate), atol=TOLERANCE)


@pytest.mark.parametrize("method", [bd.Ida(1e-6), bd.Radau(1e-6)], ids=lambda x: x.method)
@pytest.mark.parametrize("rate", [1e4, 1e7])
def test_regression_transients_of_fast_states_take_few_steps(method, rate):
    """The rate of the state was tested, and taken for the rate of the motion: runs gave up."""
    run = bd.simulate(build_lag(rate, size=2.0, start=1.0), method, t_end=1.0, output_step=0.1)
    assert run.status.success, run.status.sentence
    assert run.statistics.steps < 1000
    np.testing.assert_allclose(run["lag"].iloc[1:], 2.0 * (run.t[1:] - 1.0 / rate), atol=1e-6)


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
def test_order_of_generalized_alpha_is_two(rho_inf):
    errors = []
    for h in (0.02, 0.01, 0.005):
        run = bd.simulate(build_lag(), bd.GeneralizedAlpha(h, rho_inf), t_end=1.0)
        errors.append(np.max(np.abs(run["lag"] - lag_of(run.t))))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(orders - 2.0) < 0.2)


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 0.9, 1.0])
def test_fast_lag_is_stable_with_long_steps(rho_inf):
    run = bd.simulate(build_lag(1e6, start=0.1), bd.GeneralizedAlpha(0.01, rho_inf), t_end=4.0)
    # The start decays, except for rho_inf = 1, for which it oscillates.
    error = np.abs(run["lag"] - run["x"])
    assert np.max(error) < 0.5
    if rho_inf < 1.0:
        assert error.iloc[-1] < 1e-5


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda x: x.method)
def test_integrator_of_a_sine_and_two_states_against_a_spring(integrator):
    mech, mass = free_ball((1.0, 0.0), name="mass")
    mech.add(bd.PointOnLine("line", mech.ground.at(0.0, 0.0), mass.point))
    x = mech.sensor("x", mass.point, "x")
    mech.add(bd.Force("spring", mass.point, (-9.0 * x, 0.0)))
    position = mech.state("position", start=1.0, unit="m")
    position.follows(mech.state("velocity", -9.0 * position, unit="m/s"))
    mech.state("area", bd.sine(1.0, frequency=0.5))
    run = bd.simulate(mech, integrator, t_end=2.0, output_step=0.05)
    tolerance = 5.0 * TOLERANCE
    np.testing.assert_allclose(run["position"], np.cos(3.0 * run.t), atol=tolerance)
    np.testing.assert_allclose(run["position"], run["x"], atol=2.0 * tolerance)
    np.testing.assert_allclose(run["area"], (1.0 - np.cos(np.pi * run.t)) / np.pi, atol=tolerance)


@pytest.mark.parametrize("integrator", INTEGRATORS, ids=lambda x: x.method)
def test_closed_loop_motion(integrator):
    run = bd.simulate(pid_stage, integrator, output_step=0.05)

    def rate(t, s):
        force = KP * (TARGET - s[0]) + KI * s[2] - KD * s[1]
        return [s[1], force / MASS, TARGET - s[0]]

    expected = solve_ivp(rate, (0.0, 2.0), np.zeros(3), rtol=1e-11, atol=1e-13, t_eval=run.t)
    np.testing.assert_allclose(run["x"], expected.y[0], atol=TOLERANCE)
    np.testing.assert_allclose(run["integral"], expected.y[2], atol=TOLERANCE)
    # The force is a load; the state stores no energy.
    assert run.warnings == ()
    assert np.max(np.abs(run["energy.imbalance"])) < 1e-5


def test_poles_of_the_closed_loop():
    poles = np.sort_complex(np.roots([MASS, KD, KP, KI]))
    linear = bd.linearize(pid_stage, inputs=["target"])
    assert [x.name for x in linear.states] == ["stage.x", "integral.value", "stage.x_dot"]
    np.testing.assert_allclose(np.sort_complex(linear.poles), poles, rtol=1e-12)
    np.testing.assert_allclose(linear.B.ravel(), [0.0, 1.0, KP / MASS], rtol=1e-12)
    modes = bd.modes(pid_stage)
    upper = poles[poles.imag >= 0.0]
    np.testing.assert_allclose(np.sort_complex(modes.eigenvalues), upper, rtol=1e-12)
    assert set(modes.kinds) == {"decay", "vibration"}


@pytest.mark.slow(reason="compiles static equations of three models")
def test_equilibrium_has_zero_rates():
    mech = pid_stage(start=0.7)
    mech.add(bd.Force("weight", mech.parts["stage"].point, (6.0, 0.0)))
    equilibrium = bd.equilibrium(mech)
    names = bd.equations_of_motion(mech).q_names
    values = dict(zip(names, equilibrium.q[-1], strict=True))
    assert values["stage.x"] == pytest.approx(TARGET, rel=1e-9)
    assert values["integral.value"] == pytest.approx(-6.0 / KI, rel=1e-9)
    assert equilibrium.stable
    unstable = bd.equilibrium(pid_stage(ki=200.0))
    assert not unstable.stable
    run = bd.simulate(mech, bd.Radau(), t_end=0.5, start="equilibrium")
    assert np.ptp(run["x"]) < 1e-8


@bd.model(t_end=5.0)
def forced(stiffness=9.0, damping=0.4):
    """Vibrating mass and a state that lags its position, under a harmonic force."""
    mech, mass = mass_on_rail()
    x, v = mech.sensor("x", mass.point, "x"), mech.sensor("v", mass.point, "x_dot")
    mech.add(bd.Force("spring", mass.point, (-stiffness * x - damping * v, 0.0)))
    mech.add(bd.Force("drive", mass.point, (bd.sine(1.0, frequency=0.4), 0.0)))
    mech.state("lag", lambda lag, t: 2.0 * (x - lag))
    return mech


@pytest.mark.slow(reason="shooting")
def test_periodic_motion_and_its_multipliers():
    motion = bd.periodic(forced, period=2.5)
    omega = 0.8 * np.pi
    amplitude = abs(2.0 / (2.0 + 1j * omega) / (9.0 - omega**2 + 0.4j * omega))
    assert np.max(np.abs(motion.solution["lag"])) == pytest.approx(amplitude, rel=1e-4)
    poles = np.exp(2.5 * np.append(np.roots([1.0, 0.4, 9.0]), -2.0))
    found = motion.multipliers[:3]
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(poles), rtol=1e-5)


@pytest.mark.slow(reason="compiles static equations")
def test_loads_are_scaled_but_not_the_forces_of_controllers():
    mech = pid_stage()
    mech.add(bd.Force("weight", mech.parts["stage"].point, (6.0, 0.0)))
    path = bd.equilibrium(mech)
    assert path.loads == (("weight",),)
    names = bd.equations_of_motion(mech).q_names
    np.testing.assert_allclose(path.q[:, names.index("stage.x")], TARGET, rtol=1e-9)
    values = path.q[:, names.index("integral.value")]
    np.testing.assert_allclose(values, -6.0 * path.factors.ravel() / KI, atol=1e-12)


def test_free_motions_of_models_with_states():
    mech = build_lag()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        modes = bd.modes(mech)
    values = np.sort(modes.eigenvalues.real)
    # The ball moves freely along two axes.
    np.testing.assert_allclose(values, [-2.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("amplitude", [1.0, 1e7])
def test_regression_states_of_large_values_do_not_loosen_the_tolerance_of_bodies(amplitude):
    """Beside a pressure of 1e7 Pa, a mass that moved 0.1 m had an amplitude of 3300 m."""
    mech = bd.Mechanism()
    mass = mech.add(bd.RigidBody("mass", 1.0, 1.0, velocity=(1.0, 0.0)))
    mech.add(bd.Prismatic("rail", mech.ground.at(0.0, 0.0), mass.at(0.0, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.at(0.0, 0.0), stiffness=100.0))
    mech.state("pressure", rate=lambda x, t: amplitude * np.cos(3.0 * t), unit="Pa")
    mech.observe("mass", mass.at(0.0, 0.0))
    run = bd.simulate(mech, bd.Radau(1e-5), t_end=1.0)
    assert run.integrator["amplitudes"]["mass"] == pytest.approx(0.1, rel=0.02)
    assert np.abs(run["mass.x"] - 0.1 * np.sin(10.0 * run.t)).max() < 1e-7
    assert not run.warnings


@pytest.mark.parametrize(
    ("analysis", "sentence"),
    [
        (lambda: bd.modes(pid_stage, damping=False), "undamped modes are not supported with stat"),
    ],
)
def test_analyses_that_exclude_states_are_refused(analysis, sentence):
    with pytest.raises(bd.BeamdaeError, match=sentence):
        analysis()
