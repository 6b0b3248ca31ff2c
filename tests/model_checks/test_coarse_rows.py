"""Warnings about output rows that do not show the vibrations of columns."""

import warnings

import numpy as np
import pytest

import beamdae as bd
from beamdae.results.coarse_rows import coarse_row_warnings

FAR_APART = "rows are too far apart for its vibration"


def sentences(function, rows=401, end=1.0, header="tip.y [m]"):
    """Return the warnings of a run until `end` [s] with one column."""
    t = np.linspace(0.0, end, rows)
    evaluate = lambda x: function(x)[:, None]  # noqa: E731
    return list(coarse_row_warnings(t, {header: function(t)}, evaluate, 1.0))


@pytest.mark.parametrize("offset", [0.0, 10.0])
@pytest.mark.parametrize(
    ("rows_per_period", "is_coarse"),
    [(0.5, True), (1.0, True), (1.9, True), (3.0, True), (5.1, True), (10.0, False), (40.0, False)],
)
def test_vibrations_need_six_rows_per_period(rows_per_period, is_coarse, offset):
    frequency = 400.0 / rows_per_period
    found = sentences(lambda t: offset + 0.3 * np.sin(2.0 * np.pi * frequency * t + 0.4))
    assert len(found) == is_coarse
    if is_coarse:
        assert found[0].startswith(f"tip.y: the output {FAR_APART}")
        period = float(found[0].split("about ")[1].split(" s")[0])
        assert period == pytest.approx(1.0 / frequency, rel=0.4)  # one digit


@pytest.mark.parametrize(
    ("frequency", "end", "remedy"),
    [
        (2.03e6, 1e-3, "use output_step="),
        (2.03e6, 1.0, "read its extremes and root mean square from step_extremes, or shorten"),
    ],
)
def test_regression_vibrations_of_millions_of_rows_have_another_remedy(frequency, end, remedy):
    """Axial vibrations of short elements in a run of seconds had steps of nanoseconds."""
    (sentence,) = sentences(lambda t: np.sin(2.0 * np.pi * frequency * t + 0.4), end=end)
    assert f" s; {remedy}" in sentence


@pytest.mark.parametrize(("amplitude", "count"), [(1e-4, 0), (0.2, 1)])
def test_regression_small_rates_beside_those_of_the_point_have_no_warning(amplitude, count):
    """A frame that falls flat warned of its angular acceleration."""
    headers = "frame.ay [m/s^2]", "frame.angle_ddot [rad/s^2]"

    def evaluate(t):
        return np.column_stack([np.sin(3.0 * t), amplitude * np.sin(2e3 * t)])

    t = np.linspace(0.0, 1.0, 401)
    columns = dict(zip(headers, evaluate(t).T, strict=True))
    assert len(list(coarse_row_warnings(t, columns, evaluate, 1.0))) == count


def held(t):
    """Return values that a controller holds for 2.5 ms."""
    return np.sin(1e4 * np.floor(t / 0.0025 + 1e-6) ** 2)


@pytest.mark.parametrize(
    "function",
    [
        held,
        lambda t: np.floor(t / 1.7e-3) % 2,
        lambda t: np.sin(1e4 * np.floor(t / 8e-4) ** 2),
        lambda t: t**2,
        lambda t: np.sign(np.sin(40.0 * t)),
        lambda t: np.zeros_like(t) + 1e-13 * np.sin(1e4 * t),
        lambda t: np.sin(20.0 * t) + 0.02 * np.sin(3e3 * t),
        lambda t: np.maximum(0.0, 1.0 - ((t - 0.5) / 2e-3) ** 2),
    ],
    ids=["held", "toggle", "held between rows", "smooth", "jumps", "rounding", "small", "pulse"],
)
def test_other_columns_are_exempt(function):
    assert not sentences(function)


@pytest.mark.parametrize("values", [np.nan, np.inf])
def test_columns_that_are_not_finite_are_exempt(values):
    assert not sentences(lambda t: np.where(t > 0.5, values, np.sin(1e4 * t)))


def test_moments_of_rounding_size_are_exempt():
    t = np.linspace(0.0, 1.0, 401)

    def evaluate(x):
        return np.column_stack([np.sin(9.0 * x), 1e-9 * np.sin(2e3 * x)])

    for other in ("push [N]", "push [N m]"):
        columns = dict(zip([other, "push.M [N m]"], evaluate(t).T, strict=True))
        assert not list(coarse_row_warnings(t, columns, evaluate, 1.0))


def test_few_rows_are_exempt():
    assert not sentences(lambda t: np.sin(1e3 * t), rows=99)


@pytest.mark.slow(reason="half a second and more")
def test_regression_default_rows_of_a_long_run_that_miss_a_vibration_are_reported():
    """Cycles counted in such rows gave 57 % of the fatigue damage of a blade, without a word."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.1, 0.0)))
    mech.add(bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), ball.point, 4e4, 0.0, 1.0))
    mech.observe("ball", ball.point)
    with pytest.warns(bd.BeamdaeWarning, match=FAR_APART) as found:
        bd.simulate(mech, bd.Radau(), t_end=6.0)
    (sentence,) = [str(x.message) for x in found]
    step = float(sentence.split("output_step=")[1].removesuffix("."))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(mech, bd.Radau(), t_end=0.6, output_step=step)


def test_regression_noise_beside_a_constant_force_is_no_vibration():
    t = np.linspace(0.0, 1.0, 401)

    def evaluate(x):
        return np.column_stack([np.full(len(x), 421.2), 1e-4 + 1e-5 * np.sin(2e3 * x)])

    columns = dict(zip(["hoop.N [N]", "hoop.Q [N]"], evaluate(t).T, strict=True))
    assert not list(coarse_row_warnings(t, columns, evaluate, 1.0))
    del columns["hoop.N [N]"]
    assert list(coarse_row_warnings(t, columns, lambda x: evaluate(x)[:, 1:], 1.0))


@pytest.mark.parametrize(("rtol", "count"), [(1e-3, 0), (1e-5, 1)])
def test_regression_errors_of_constraints_are_no_vibrations(rtol, count):
    """At coarse tolerances, held points seemed to vibrate: 1e-5 of the largest velocity."""
    t = np.linspace(0.0, 1.0, 401)

    def evaluate(x):
        return np.column_stack([1e-5 * np.sin(1e3 * x), np.cos(5.0 * x)])

    columns = dict(zip(["held.y_dot [m/s]", "tip.y_dot [m/s]"], evaluate(t).T, strict=True))
    assert len(list(coarse_row_warnings(t, columns, evaluate, 1.0, rtol))) == count


def test_regression_the_drift_of_a_bearing_at_constant_speed_is_no_vibration():
    """Without other motions than that of the shaft, 1e-9 m/s at its center were a vibration."""
    t = np.linspace(0.0, 0.1, 126)

    def evaluate(x):
        return np.column_stack([1e-9 * np.sin(1e4 * x), np.full(len(x), 50.0)])

    columns = dict(
        zip(["shaft.y_dot [m/s]", "shaft.angle_dot [rad/s]"], evaluate(t).T, strict=True)
    )
    assert list(coarse_row_warnings(t, columns, evaluate, 0.2, 1e-5))
    assert not list(coarse_row_warnings(t, columns, evaluate, 0.2, 1e-5, lambda: (1e-12, 1e-9)))


@pytest.mark.parametrize("amplitude", [0.08, 0.2])
def test_regression_the_recommended_step_shows_fast_vibrations_of_a_slow_motion(amplitude):
    """The period of the slow motion was named, with an `output_step` above the present one."""

    def swing(t):
        return np.sin(1.5 * t) + amplitude * np.sin(1e3 * t)

    (found,) = sentences(swing)
    step = float(found.split("output_step=")[1].removesuffix("."))
    assert step < 1e-3
    assert not sentences(swing, rows=round(1.0 / step) + 1)


def test_vibrations_that_begin_late_are_reported():
    assert sentences(lambda t: np.where(t > 0.5, np.sin(1e3 * (t - 0.5)), 0.0))


@pytest.mark.parametrize("integrator", [bd.Auto(), bd.GeneralizedAlpha(step=0.005)])
def test_regression_constant_reactions_do_not_vibrate(integrator):
    """Rounding errors of reactions at rest had a warning with a period of microseconds."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    body = mech.add(bd.RigidBody("body", 1.0, 0.1, center=(0.3, 0.4)))
    weld = mech.add(bd.Weld("weld", mech.ground.at(0.0, 0.0), body.at(0.0, 0.0)))
    mech.observe("weld", weld.reaction)
    assert bd.simulate(mech, integrator, t_end=1.0).warnings == ()
