"""Time laws: values, derivatives and breakpoints."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

import beamdae as bd
from beamdae.parts.laws import as_law
from beamdae.symbolic.statements import SX

numbers = st.floats(-10.0, 10.0).map(lambda x: round(x, 6))
times = st.floats(0.05, 10.0)
ROUNDING = {"rtol": 1e-12, "atol": 1e-12}


@cache
def derivative(law, order):
    time = SX.sym("time", 2)
    expression = as_law("test", law)(time)
    for _ in range(order):
        expression = ca.jtimes(expression, time, SX([1, 0]))
    return ca.Function("law", [time], [expression])


def value(law, t, phase=None, order=0):
    """Return the law or a derivative at t, of the piece valid at `phase` (default: t)."""
    return float(derivative(law, order)([t, t if phase is None else phase]))


@given(amplitude=numbers, frequency=times, phase=numbers, t=times)
def test_sine(amplitude, frequency, phase, t):
    law = bd.sine(amplitude, frequency, phase)
    # Rounding error of the argument, up to 600 rad.
    expected = amplitude * np.sin(2.0 * np.pi * frequency * t + phase)
    assert_allclose(value(law, t), expected, atol=1e-11)
    assert law.breakpoints == ()
    assert law.time_scale == 1.0 / frequency


@given(speed=numbers, duration=times)
def test_run_up_is_twice_continuously_differentiable_and_reaches_its_speed(speed, duration):
    law = bd.run_up(speed, duration)
    assert law.breakpoints == (duration,)
    for order in range(3):
        before = value(law, duration, 0.5 * duration, order)
        after = value(law, duration, 2.0 * duration, order)
        # Rounding error of 1 - cos at a full revolution, multiplied by (2 pi / duration)^order.
        assert_allclose(before, after, atol=1e-12 * abs(speed) * (1.0 + duration**-order))
        assert_allclose(value(law, 0.0, 0.0, order), 0.0, atol=1e-13 * abs(speed) / duration)
    assert_allclose(value(law, 3.0 * duration, order=1), speed, **ROUNDING)
    assert_allclose(value(law, 0.5 * duration, order=1), 0.5 * speed, **ROUNDING)
    assert_allclose(value(law, 3.0 * duration), 2.5 * speed * duration, **ROUNDING)
    # The angular acceleration is 1 - cos over a full revolution: twice its mean in the middle.
    assert_allclose(value(law, 0.5 * duration, order=2), 2.0 * speed / duration, **ROUNDING)


def test_third_derivative_of_run_up_is_continuous_and_the_fourth_is_not():
    law = bd.run_up(2.0, 0.5)
    assert_allclose(value(law, 0.5, 0.4, 3), 0.0, atol=1e-10)
    assert abs(value(law, 0.5, 0.4, 4)) > 100.0


@given(ends=st.lists(times, min_size=1, max_size=4, unique=True), t=st.floats(0.0, 12.0))
def test_piecewise_changes_at_its_ends(ends, t):
    ends = sorted(ends)
    law = bd.piecewise(*[(end, float(i)) for i, end in enumerate(ends)], lambda t: t + 10.0)
    assert law.breakpoints == tuple(ends)
    branch = sum(t >= end for end in ends)
    assert_allclose(value(law, t), branch if branch < len(ends) else t + 10.0, rtol=1e-15)


def test_the_piece_is_selected_by_phase_instead_of_time():
    law = bd.piecewise((1.0, lambda t: 3.0 * t), (2.0, 7.0), lambda t: -t)
    assert value(law, 1.0, phase=0.5) == 3.0
    assert value(law, 1.0, phase=1.0) == 7.0
    assert value(law, 1.0, phase=1.5) == 7.0
    assert value(law, 2.0, phase=1.5) == 7.0
    assert value(law, 2.0, phase=2.5) == -2.0
    # A piece is defined beyond its end, because integrators may evaluate it there.
    assert value(law, 1.2, phase=0.5) == pytest.approx(3.6, rel=1e-15)
    assert value(law, 1.0, phase=0.5, order=1) == 3.0
    assert value(law, 1.0, phase=1.5, order=1) == 0.0


def test_a_piece_may_be_singular_outside_its_interval():
    law = bd.piecewise((1.0, 2.0), lambda t: np.sqrt(t - 1.0))
    assert value(law, 0.25) == 2.0
    assert value(law, 1.25) == 0.5
    assert value(law, 0.25, order=1) == 0.0


def test_a_piece_may_itself_be_piecewise():
    table, run_up = bd.table([0.0, 1.0, 2.0, 3.0], [0.0, 2.0, 1.0, 5.0]), bd.run_up(3.0, 1.0)
    law = bd.piecewise((0.5, 1.0), (2.5, table), (2.7, bd.piecewise((2.6, 7.0), 8.0)), run_up)
    # Breakpoints of the pieces at 0, 1 and 3 s are outside the intervals of the pieces.
    assert law.breakpoints == (0.5, 2.5, 2.6, 2.7)
    assert law.time_scale == min(as_law("test", table).time_scale, run_up.time_scale)
    pieces = {0.2: 1.0, 0.5: table, 2.4: table, 2.55: 7.0, 2.6: 8.0, 9.0: run_up}
    for t, piece in pieces.items():
        assert value(law, t) == pytest.approx(value(piece, t), rel=1e-14)
    early = bd.piecewise((2.0, run_up), table)
    assert early.breakpoints == (1.0, 2.0, 3.0)
    for t, piece in [(0.5, run_up), (1.5, run_up), (2.0, table), (2.9, table), (4.0, table)]:
        assert value(early, t) == pytest.approx(value(piece, t), rel=1e-14)


def test_time_scales():
    assert bd.run_up(1.0, 0.5).time_scale == 0.5
    # Integrators stop at the ends of pieces, so a short piece does not limit other steps.
    assert bd.piecewise((1.0, 5.0), (1.2, 3.0), 0.0).time_scale is None
    assert bd.piecewise((1.0, bd.sine(1.0, 50.0)), 0.0).time_scale == 0.02
    assert as_law("test", 5.0).time_scale is None
    assert as_law("test", bd.table([0.0, 0.1, 1.0], [0.0, 1.0, 0.0])).time_scale == pytest.approx(
        0.4
    )


@pytest.mark.slow(reason="a quarter of a second")
@given(
    steps=st.lists(times, min_size=2, max_size=6),
    values=st.lists(numbers, min_size=7, max_size=7),
    start=numbers,
)
def test_table_interpolates_and_is_constant_outside(steps, values, start):
    t = start + np.concatenate([[0.0], np.cumsum(steps)])
    y = np.array(values[: len(t)])
    law = bd.table(t, y)
    # Rounding error of cubic polynomials with values up to 10 on intervals that differ 200-fold.
    for ti, yi in zip(t, y, strict=True):
        assert_allclose(value(law, ti), yi, atol=1e-9)
        assert_allclose(value(law, ti, phase=0.5 * (t[0] + t[1])), yi, atol=1e-9)
    assert value(law, t[0] - 1.0) == y[0]
    assert value(law, t[-1] + 1.0) == y[-1]
    assert as_law("test", law).breakpoints == (t[0], t[-1])


def test_table_is_a_cubic_spline():
    t = np.array([0.0, 0.3, 1.0, 1.4, 2.0])
    law = bd.table(t, [0.0, 1.0, -0.5, 0.2, 0.0])
    inside = 1.0
    for knot in t[1:-1]:
        for order in (1, 2):
            below, above = (value(law, knot + d, inside, order) for d in (-1e-9, 1e-9))
            # The next derivative is at most several hundred.
            assert_allclose(below, above, atol=1e-5)


def test_table_reproduces_a_cubic_polynomial():
    t = np.array([0.0, 0.3, 1.0, 1.4, 2.0])
    law = bd.table(t, t**3 - 2.0 * t)
    for at in (0.1, 1.2, 1.9):
        assert_allclose(value(law, at), at**3 - 2.0 * at, **ROUNDING)


def test_regression_rows_of_a_bump_begin_and_end_at_rest():
    """With natural ends, 41 rows jumped to 4 % of the largest speed; a stress was wrong by 20 %."""
    t = np.linspace(0.0, 0.1, 41)
    law = bd.table(t, 0.5 - 0.5 * np.cos(20.0 * np.pi * t))
    for end in (1e-12, 0.1 - 1e-12):
        # Errors of the slope are of third order in the distance of the rows.
        assert abs(value(law, end, order=1)) < 1e-3 * 10.0 * np.pi


def test_table_reproduces_a_line():
    law = bd.table([0.0, 0.4, 1.0, 3.0], [1.0, 1.8, 3.0, 7.0])
    for t in (0.1, 0.4, 0.9, 2.2):
        assert_allclose(value(law, t), 1.0 + 2.0 * t, **ROUNDING)
        assert_allclose(value(law, t, order=1), 2.0, **ROUNDING)


@pytest.mark.parametrize(
    ("law", "t", "expected"),
    [
        (3.0, 2.0, 3.0),
        (np.float64(2.5), 0.0, 2.5),
        (lambda t: 2.0, 1.0, 2.0),
        (lambda t: np.sin(t) * np.exp(-t) + (t + 1.0) ** 0.5, 0.7, None),
    ],
)
def test_numbers_and_numpy_formulas_are_laws(law, t, expected):
    expected_value = float(law(t)) if expected is None else expected
    assert_allclose(value(law, t), expected_value, rtol=1e-15)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("fast", "motor: law must be a number, got 'fast'"),
        (None, "motor: law must be a number, got None"),
        ([1.0, 2.0], r"motor: law must be a number, got \[1.0, 2.0\]"),
        (np.nan, "motor: law must be finite, got nan"),
        (-np.inf, "motor: law must be finite, got -inf"),
        (lambda t: "fast", "motor: the law must return one number, got 'fast'"),
        (lambda t: None, "motor: the law must return one number, got None"),
        (lambda: 1.0, "motor: the law must be a formula in t .* positional argument"),
        (lambda t: 1.0 / 0.0, "motor: the law must be a formula in t .* division by zero"),
        (lambda t: t if t > 1.0 else 0.0, "motor: the law must be a formula in t"),
        (lambda t: np.array([1.0, 2.0]), "motor: the law must return one number"),
        (lambda t: ca.SX.sym("x"), "motor: the law must depend only on t, not on x"),
        (lambda t: np.nan, "motor: the law must be finite, got nan at t = 0"),
        (lambda t: 1.0 / t, "motor: the law must be finite, got inf at t = 0"),
    ],
)
def test_invalid_laws_are_rejected(law, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        as_law("motor", law)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bd.sine(np.nan, 1.0), "sine: amplitude must be finite, got nan"),
        (lambda: bd.sine(1.0, 0.0), "sine: frequency must be positive, got 0"),
        (lambda: bd.sine(1.0, 1.0, "late"), "sine: phase must be a number, got 'late'"),
        (lambda: bd.run_up(1.0, -1.0), "run_up: duration must be positive, got -1"),
        (lambda: bd.run_up(np.inf, 1.0), "run_up: speed must be finite, got inf"),
        (lambda: bd.piecewise(), "piecewise: .* give at least one law"),
        (lambda: bd.piecewise(1.0, 2.0), r"piecewise: .* a pair \(end time, law\), got 1.0"),
        (
            lambda: bd.piecewise((2.0, 1.0), (1.0, 2.0), 0.0),
            r"piecewise: end times must ascend, got \[2.0, 1.0\]",
        ),
        (lambda: bd.piecewise((1.0, 1.0), (1.0, 2.0), 0.0), "piecewise: end times must ascend"),
        (lambda: bd.piecewise((np.inf, 1.0), 0.0), "piecewise: end time must be finite, got inf"),
        (lambda: bd.piecewise((1.0, "fast"), 0.0), "piecewise: law must be a number, got 'fast'"),
        (
            lambda: bd.piecewise((1.0, 2.0), lambda t: 1.0 / (t - 1.0)),
            "piecewise: the law must be finite, got inf at t = 1",
        ),
        (
            lambda: bd.table([0.0, 1.0], [1.0, 2.0]),
            "table: x must have at least 3 entries for kind='spline', got 2",
        ),
        (
            lambda: bd.table([0.0, 1.0, 2.0], [1.0, 2.0]),
            "table: x and y must be lists of the same length, got 3 and 2",
        ),
        (
            lambda: bd.table([0.0, 1.0, 1.0], [1.0, 2.0, 3.0]),
            "table: x must ascend, but 1 is followed by 1",
        ),
        (
            lambda: bd.table([0.0, 1.0, 2.0], [1.0, np.nan, 3.0]),
            "table: y must be finite, got nan",
        ),
        (
            lambda: bd.table(["a", "b", "c"], [1.0, 2.0, 3.0]),
            "table: x must be a number, got 'a'",
        ),
    ],
)
def test_error_messages(make, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        make()


def test_equations_collect_the_breakpoints_of_drivers_and_loads():
    mech = bd.Mechanism()
    wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=1.0))
    hub = wheel.at(0.0, 0.0)
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub))
    mech.add(bd.Driver("motor", mech.ground.at(0.0, 0.0), hub, law=bd.run_up(1.0, 0.5)))
    mech.add(bd.Moment("brake", hub, bd.piecewise((0.5, 0.0), (2.0, -1.0), 0.0)))
    mech.add(bd.Force("push", hub, (bd.sine(1.0, 10.0), bd.piecewise((1.0, 1.0), 0.0))))
    equations = bd.equations_of_motion(mech)
    assert equations.breakpoints == (0.5, 1.0, 2.0)
    assert equations.time_scale == 0.1


@pytest.mark.parametrize(
    ("law", "what"),
    [
        (lambda t: np.where(abs(t - 5.0) < 0.02, 100.0, 0.0), "lt"),
        (lambda t: np.fmin(100.0 * t, 1.0), "fmin"),
        (lambda t: np.floor(t), "floor"),
        (lambda t: np.abs(t - 1.0), "fabs"),
    ],
)
def test_nonsmooth_laws_are_rejected(law, what):
    with pytest.raises(
        bd.BeamdaeError, match=rf"motor: the law must be smooth, .*{what}.*piecewise"
    ):
        as_law("motor", law)


@pytest.mark.parametrize(
    ("pieces", "breakpoints", "message"),
    [
        (1, (1.0,), "1 pieces require 0 breakpoints, got 1"),
        (3, (2.0, 1.0), "breakpoints must ascend"),
    ],
)
def test_law_rejects_invalid_breakpoints(pieces, breakpoints, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.Law(tuple(lambda t: t for _ in range(pieces)), breakpoints)


def test_law_rejects_pieces_that_are_not_functions():
    with pytest.raises(bd.BeamdaeError, match="pieces must be a tuple of functions"):
        bd.Law(np.sin)


def test_regression_tables_have_values_at_numbers():
    """The steps of the spline accepted symbols only."""
    law = bd.table([0.0, 1.0, 2.0, 4.0], [0.0, 1.0, 0.0, 2.0])
    at_rows = [law.at(t) for t in (-1.0, 0.0, 1.0, 2.0, 4.0, 5.0)]
    assert at_rows == pytest.approx([0.0, 0.0, 1.0, 0.0, 2.0, 2.0], abs=1e-14)
    spline = CubicSpline([0.0, 1.0, 2.0, 4.0], [0.0, 1.0, 0.0, 2.0], bc_type="not-a-knot")
    assert law.at(2.7) == pytest.approx(float(spline(2.7)), rel=1e-14)
    assert bd.piecewise((9.0, 1.0), law).at(9.5) == 2.0


@pytest.mark.parametrize("time", [2.0, np.linspace(0.0, 1.0, 3), [1.0, 2.0], "2"])
def test_regression_calls_of_laws_name_the_method(time):
    """A TypeError said that 'float' object is not subscriptable."""
    for law in (bd.run_up(1.0, 2.0), bd.sine(1.0, 2.0), bd.piecewise((1.0, 0.0), 1.0)):
        with pytest.raises(bd.BeamdaeError, match=r"use law\.at\(t\) for its value at a number t"):
            law(time)
