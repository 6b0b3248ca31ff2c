"""Inputs and sensors in laws and formulas, in all integrators, linear models and observables."""

import math

import numpy as np
import pytest
from mechanisms import free_ball, hinged_body
from numpy.testing import assert_allclose

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
