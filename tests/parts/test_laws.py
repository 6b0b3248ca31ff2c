"""Time laws: values, derivatives and breakpoints."""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import free_ball, hinged_body
from numpy.testing import assert_allclose

import beamdae as bd

numbers = st.floats(-10.0, 10.0).map(lambda x: round(x, 6))
times = st.floats(0.05, 10.0)
ROUNDING = {"rtol": 1e-12, "atol": 1e-12}


@cache
def derivative(law, order):
    time = ca.SX.sym("time", 2)
    expression = bd.piecewise(law)(time)
    for _ in range(order):
        expression = ca.jtimes(expression, time, ca.SX([1, 0]))
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


@given(peak=numbers, duration=times, start=numbers, part=st.floats(-1.0, 2.0))
def test_half_sine(peak, duration, start, part):
    law = bd.half_sine(peak, duration, start)
    assert law.breakpoints == (start, start + duration)
    t = start + part * duration
    expected = peak * np.sin(np.pi * part) if start <= t < start + duration else 0.0
    # Rounding error of the argument pi t / duration, up to 800 rad.
    assert_allclose(law.at(t), expected, atol=1e-11)
    assert_allclose(value(law, t), law.at(t), atol=1e-11)


SUMMANDS = {
    "number": -9.81,
    "function": lambda t: 1.0 + np.cos(3.0 * t),
    "pulse": bd.half_sine(2.0, 0.3, 0.1),
    "smooth table": bd.table([0.0, 0.2, 0.5], [0.0, 1.0, 3.0], outside="hold"),
    "linear table": bd.piecewise(bd.table([0.0, 0.2, 0.5], [0.0, 1.0, 3.0], kind="linear")),
    "steps": bd.piecewise((0.2, 1.0), (0.4, lambda t: t), 5.0),
}


@pytest.mark.parametrize("first", SUMMANDS)
@pytest.mark.parametrize("second", ["pulse", "linear table", "steps"])
@pytest.mark.parametrize("order", [1, -1])
def test_laws_add_up_with_the_breakpoints_of_both(first, second, order):
    one, other = bd.piecewise(SUMMANDS[first]), SUMMANDS[second]
    pair = (SUMMANDS[first], other)[::order]
    if not isinstance(pair[0], bd.results.Law) and first == "smooth table":
        pair = one, other  # A table has no sum of its own.
    law = pair[0] + pair[1]
    assert law.breakpoints == tuple(sorted({*one.breakpoints, *other.breakpoints}))
    scales = [x for x in (one.time_scale, other.time_scale) if x is not None]
    assert law.time_scale == min(scales, default=None)
    for t in (-0.3, 0.0, 0.15, 0.2, 0.37, 0.45, 0.9):
        assert law.at(t) == pytest.approx(one.at(t) + other.at(t), rel=1e-14)
        assert value(law, t) == pytest.approx(law.at(t), rel=1e-12)


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
    assert law.time_scale == min(bd.piecewise(table).time_scale, run_up.time_scale)
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
    spline = bd.piecewise(bd.table([0.0, 0.1, 1.0], [0.0, 1.0, 0.0]))
    assert spline.time_scale == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("law", "t", "expected"),
    [
        (3.0, 2.0, 3.0),
        (np.float64(2.5), 0.0, 2.5),
        (lambda t: 2.0, 1.0, 2.0),
        (lambda t: np.sin(t) * np.exp(-t) + (t + 1.0) ** 0.5, 0.7, None),
        (bd.piecewise(lambda t: np.squeeze(np.array([2.0 * t], dtype=object))), 0.7, 1.4),
    ],
)
def test_numbers_and_numpy_formulas_are_laws(law, t, expected):
    expected_value = float(law(t)) if expected is None else expected
    assert_allclose(value(law, t), expected_value, rtol=1e-15)


def test_laws_are_objects_without_a_hash():
    @dataclass
    class Ramp:
        rate: float

        def __call__(self, t):
            return self.rate * t

    mech, ball = free_ball()
    mech.add(bd.Force("push", ball.point, (Ramp(2.0), bd.piecewise((1.0, 0.0), 3.0) + Ramp(3.0))))
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=2.0)
    assert_allclose(run["ball.x"].iloc[-1], 2.0 * 2.0**3 / 6.0, rtol=1e-6)
    assert_allclose(run["ball.y"].iloc[-1], 3.0 * 2.0**3 / 6.0 + 1.5, rtol=1e-6)


class HalvedLaw(bd.results.Law):
    """Law with half the value of its pieces."""

    def __call__(self, time):
        return 0.5 * super().__call__(time)


def test_law_of_a_user_class_is_evaluated_by_itself():
    whole, runs = bd.sine(3.0, 2.0, 0.4), []
    for law in (whole, HalvedLaw(whole.pieces)):
        mech, body = hinged_body()
        mech.add(bd.Moment("moment", on=body.at(0.0, 0.0), law=law))
        mech.observe("body", body.at(0.0, 0.0))
        runs.append(bd.simulate(mech, bd.GeneralizedAlpha(step=0.01), t_end=0.1))
    one, half = (run["body.angle"] for run in runs)
    assert one.abs().max() > 0.01
    assert_allclose(half, 0.5 * one, rtol=1e-9, atol=1e-12)
