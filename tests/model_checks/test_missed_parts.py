"""Warnings about extremes of parts of a run that the output rows miss."""

import re
import warnings

import numpy as np
import pytest

import beamdae as bd
from beamdae.results.missed_parts import (
    MissedPart,
    PartExtremes,
    missed_part_warnings,
)

T = np.linspace(0.0, 1.0, 401)


def find_parts(function, rows=401):
    """Return the missed parts of a column with a hundred steps per output step of 2.5 ms."""
    t = np.linspace(0.0, 1.0, rows)
    extremes = PartExtremes(t, function(t)[:, None])
    for steps in np.array_split(np.linspace(0.0, 1.0, 40001), 7):
        extremes.extend(steps, function(steps)[:, None])
    (parts,) = extremes.finish(1)
    return parts


def ring(t):
    """Return a pulse at the start, and a later vibration with 4.2 of 401 rows per period."""
    after = np.maximum(t - 0.501, 0.0)
    vibration = np.sin(800.0 * np.pi / 4.2 * after) * np.exp(-after / 0.01)
    return np.exp(-((t / 0.02) ** 2)) + vibration


@pytest.mark.parametrize(("rows", "count"), [(401, 1), (801, 0), (2001, 0), (99, 0)])
def test_vibrations_after_an_event_are_missed_by_coarse_rows(rows, count):
    largest = [x for x in find_parts(ring, rows) if x.sign == 1]
    assert len(largest) == count
    if rows == 401:
        (part,) = largest
        assert part.begin <= 0.501 < part.end
        assert part.value == pytest.approx(np.max(ring(np.linspace(0.4, 0.7, 10001))), rel=1e-3)
        assert part.row_value == pytest.approx(np.max(ring(T[T > 0.4])))


@pytest.mark.parametrize(
    "function",
    [
        lambda t: np.sin(800.0 * np.pi / 7.3 * t),
        lambda t: np.sin(20.0 * t) + 0.02 * np.sin(3e3 * t),
        lambda t: np.sign(np.sin(40.0 * t)),
        lambda t: t**2,
        lambda t: np.zeros_like(t),
        lambda t: np.where(t > 0.5, np.nan, np.sin(1e4 * t)),
        lambda t: np.sin(9.0 * t) + np.sin(1250.0 * t) * (t < 0.0025),
    ],
    ids=["seven rows", "small", "jumps", "smooth", "zero", "not a number", "start"],
)
def test_other_columns_are_exempt(function):
    assert find_parts(function) == ()


MISSED = "the output rows miss its (largest|smallest) value"


def push(t, time, duration):
    """Return a smooth pulse of a force of 1 N around a time, or of an array of times."""
    return np.exp(-(((t - time) / duration) ** 2))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("speed", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("integrator", [bd.Auto(), bd.Ida(), bd.GeneralizedAlpha(rtol=1e-5)])
def test_regression_ringing_after_a_push_that_the_rows_miss_is_reported(integrator, speed):
    """The largest forces are those of slow pushes before, and most gaps between rows are smooth."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(1.0, 0.0)))
    stiffness, damping = 3.6e5 * speed**2, 60.0 * speed
    spring = bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), ball.point, stiffness, damping)
    mech.add(spring)

    def law(t):
        slow = push(speed * t, 0.2, 0.05) - push(speed * t, 0.4, 0.05)
        return 400.0 * slow + 230.0 * push(speed * t, 0.6517, 0.003)

    mech.add(bd.Force("push", ball.point, (law, 0.0)))
    mech.observe("spring", spring.force)
    with pytest.warns(bd.BeamdaeWarning, match=f"spring: between .*{MISSED}") as messages:
        run = bd.simulate(mech, integrator, t_end=1.0 / speed, output_step=2.5e-3 / speed)
    (sentence,) = [str(x.message) for x in messages if "between" in str(x.message)]
    step = float(sentence.split("output_step=")[1].removesuffix("."))
    assert 0.2e-3 < speed * step < 1.5e-3
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*rows")
        resolved = bd.simulate(mech, integrator, t_end=1.0 / speed, output_step=step)
    (header,) = run.columns
    later = resolved.t > 0.6 / speed
    value = float(sentence.split("value, ")[1].split(" ")[0])
    extremes = [x(resolved.columns[header][later]) for x in (np.min, np.max)]
    assert min(abs(extremes - np.array(value))) < 0.02 * np.ptp(run.columns[header])


def test_regression_values_and_rows_of_parts_are_told_apart():
    """Four digits showed the same value twice if a position hardly changes."""
    values = {"tip.x [m]": (0.49999921, 0.49999901), "tip.y [m]": (-0.70000031, -0.70000011)}
    missed = {x: MissedPart(0.0, 1.0, 1, *pair) for x, pair in values.items()}
    times = np.linspace(0.0, 1.0, 101)

    def observe_at(t):
        return {x: value - 1e-7 * (t - 0.5) ** 2 for x, (value, _) in values.items()}

    half_ranges = dict.fromkeys(values, 2e-7)
    (warning,) = missed_part_warnings(missed, half_ranges, times, times, observe_at)
    for pair in values.values():
        assert all(f"{x:.8g} m" in warning for x in pair)


@pytest.mark.parametrize(
    ("duration", "remedy"),
    [
        (1e-3, "use output_step=[1-9]e-04."),
        (1e-7, "use this value, because the peak is too short for output rows."),
        (0.0, "use this value, because the peak is too short for output rows."),
    ],
)
def test_regression_steps_of_millions_of_rows_are_not_proposed(duration, remedy):
    """A friction force that reversed within a step had the remedy output_step=1e-08."""
    part = MissedPart(0.5, 0.6, 1, 3.0, 1.0)
    nodes = np.sort([*T, 0.55123])

    def observe_at(t):
        return {"lip.T [N]": 1.0 + 2.0 * (np.abs(t - 0.55123) <= 0.5 * duration)}

    (warning,) = missed_part_warnings({"lip.T [N]": part}, {"lip.T [N]": 3.0}, T, nodes, observe_at)
    assert re.search(rf"3 N at t = 0.55123 s, and reach only 1 N; {remedy}$", warning)


def test_the_step_serves_the_columns_that_rows_can_show():
    """The remedy is that of the worst column, and one short peak of another does not change it."""
    values = {"a [N]": 3.0, "b [N]": 2.5}
    missed = {x: MissedPart(0.5, 0.6, 1, value, 1.0) for x, value in values.items()}

    def observe_at(t):
        return {
            "a [N]": 1.0 + 2.0 * (np.abs(t - 0.551) < 5e-4),
            "b [N]": 1.0 + 1.5 * (t == 0.55123),
        }

    half_ranges = dict.fromkeys(missed, 3.0)
    nodes = np.sort([*T, 0.551, 0.55123])
    (warning,) = missed_part_warnings(missed, half_ranges, T, nodes, observe_at)
    assert re.search(r"extremes of b .* in parts of the run; use output_step=[1-9]e-04\.$", warning)
