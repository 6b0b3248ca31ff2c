"""Warnings about contacts whose restitution holds at another speed than that of their impacts."""

import math
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.model_checks import impact_speeds
from beamdae.parts.forces import contact
from beamdae.parts.forces.contact import hysteresis_factor, restitution_at

SPEED = 3.7  # m/s


def drop(impact_speed, restitution=0.6, height=0.01, gravity=0.0):
    """Return the rebound of a ball that falls at 3.7 m/s, and the warnings about it."""
    mech = bd.Mechanism(gravity=(0.0, -gravity))
    ball = mech.add(bd.PointMass("ball", 0.3, at=(0.0, height), velocity=(0.0, -SPEED)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    settings = {"restitution": restitution, "impact_speed": impact_speed}
    mech.add(bd.Contact("bounce", ball.point, floor, 8e6, **settings))
    mech.observe("ball", ball.point)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = bd.simulate(mech, bd.Radau(1e-6), t_end=0.02, output_step=1e-4)
    texts = [x for x in solution.warnings if "impact_speed" in x]
    return np.asarray(solution["ball.y_dot"])[-1] / SPEED, texts


@pytest.mark.parametrize("impact_speed", [1e-3, 1.0, 3.7e3])
def test_regression_impacts_far_from_the_given_speed_have_a_warning(impact_speed):
    """Rebounds of 0 or 100 % were silent where 60 % were specified at another speed."""
    rebound, (text,) = drop(impact_speed)
    assert_allclose(rebound, restitution_at(SPEED, 0.6, impact_speed), rtol=2e-3, atol=2e-4)
    assert f"the restitution is {rebound:.2g}," in text
    assert "bounce: the fastest impact is at 3.7 m/s" in text


def test_regression_contacts_with_one_law_have_one_warning():
    """Each corner of a frame had a warning."""
    mech = bd.Mechanism()
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    settings = {"restitution": 0.6, "impact_speed": 1.0}
    for k, speed in enumerate((5.0, 4.0, 6.0)):
        velocity = (0.0, -speed)
        ball = mech.add(bd.PointMass(f"ball {k}", 0.3, at=(k, 0.01), velocity=velocity))
        mech.add(bd.Contact(f"bounce {k}", ball.point, floor, 8e6, **settings))
    mech.observe("ball", ball.point)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = bd.simulate(mech, bd.Radau(1e-6), t_end=0.005, output_step=1e-4)
    (text,) = (x for x in solution.warnings if "impact_speed" in x)
    assert text.startswith("bounce 2 (also bounce 0, bounce 1): the fastest impact is at 6 m/s")


@pytest.mark.parametrize(
    ("impact_speed", "restitution"), [(SPEED, 0.6), (2.0, 0.6), (7.0, 0.6), (1.0, 0.99)]
)
def test_impacts_near_the_given_speed_and_without_losses_have_no_warning(impact_speed, restitution):
    assert not drop(impact_speed, restitution)[1]


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("height", [0.0, -1e-17, 5e-17, 1e-9])
def test_regression_impacts_at_the_start_of_a_run_are_the_fastest(height):
    """Slower rebounds were called the fastest impact of a ball that touches at the start."""
    # The ball falls again at 1.5 m/s.
    assert not drop(SPEED, 0.4, height=height, gravity=2000.0)[1]
    (text,) = drop(1.0, height=height)[1]
    assert "bounce: the fastest impact is at 3.7 m/s" in text


def test_bodies_that_slide_along_each_other_at_the_start_have_no_impact():
    mech = bd.Mechanism()
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0), (1.0, 0.3))
    ball = mech.add(bd.PointMass("ball", 0.3, at=(1.0, 0.3), velocity=(1.0, 0.3)))
    mech.add(bd.Contact("slide", ball.point, floor, 8e6, restitution=0.6, impact_speed=SPEED))
    solution = bd.simulate(mech, bd.Radau(1e-6), t_end=0.02)
    assert not [x for x in solution.warnings if "impact_speed" in x]


def test_regression_bodies_that_slide_along_a_circle_at_the_start_have_no_impact():
    """The fastest impact was said to be at 0.25 mm/s."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    hill = bd.CircleSurface(mech.ground.at(0.0, 0.0), 1.0)
    ball = mech.add(bd.PointMass("ball", 0.3, at=(0.0, 1.0), velocity=(0.5, 0.0)))
    mech.add(bd.Contact("slide", ball.point, hill, 8e6, restitution=0.6, impact_speed=1.0))
    for method in (bd.GeneralizedAlpha(1e-3), bd.Ida(1e-4)):
        solution = bd.simulate(mech, method, t_end=0.03)
        assert not [x for x in solution.warnings if "impact_speed" in x]


def test_regression_gaps_by_rounding_at_the_start_are_closed():
    """A ball in a bowl, with a gap of 2e-16 m, had an impact at 1.3e-7 m/s."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bowl = bd.CircleSurface(mech.ground.at(0.0, 0.0), 1.0, side="inside")
    ball = mech.add(bd.PointMass("ball", 0.3, at=(0.0, -1.0 + 2.3e-16), velocity=(0.5, 0.0)))
    mech.add(bd.Contact("slide", ball.point, bowl, 8e6, restitution=0.6, impact_speed=1.0))
    solution = bd.simulate(mech, bd.GeneralizedAlpha(1e-3), t_end=0.03)
    assert not [x for x in solution.warnings if "impact_speed" in x]


@pytest.mark.parametrize(("record", "speed", "count"), [(None, 0.5, 1), ("", 0.5, 0), ("", 9.0, 1)])
def test_long_runs_that_store_some_steps_are_not_called_too_slow(record, speed, count, monkeypatch):
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 0.3, at=(0.0, 0.01)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("bounce", ball.point, floor, 8e6, restitution=0.6, impact_speed=SPEED))
    monkeypatch.setattr(impact_speeds, "_fastest_impact", lambda gap, interval: speed)
    trajectory = SimpleNamespace(
        intervals=(SimpleNamespace(record=record),),
        stores_all_steps=record is None,
        start=0.0,
        end=1.0,
    )
    equations = bd.equations_of_motion(mech)
    assert len(list(impact_speeds.impact_speed_warnings(equations, trajectory))) == count


def test_regression_bodies_that_are_pressed_together_have_no_impact(monkeypatch):
    """A strip that a contact pressed from the start had "the fastest impact is at 3e-9 m/s"."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 0.3, at=(0.0, 0.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("rest", ball.point, floor, 8e6, restitution=0.3, impact_speed=0.05))
    run = bd.simulate(mech, t_end=0.1, start="equilibrium")
    monkeypatch.setattr(impact_speeds, "_fastest_impact", lambda gap, interval: 3.3e-9)
    assert not list(impact_speeds.impact_speed_warnings(run.equations, run.trajectory))
    # Nor has a run that stops at once.
    at_once = SimpleNamespace(intervals=run.trajectory.intervals, start=0.0, end=0.0)
    assert not list(impact_speeds.impact_speed_warnings(run.equations, at_once))


def test_restitution_at_other_speeds_has_the_same_hysteresis():
    for speed in (1e-9, 1e-3, 1.0, 1e3):
        restitution = restitution_at(speed, 0.6, SPEED)
        # The series for small losses is accurate to their size, 2e-4 at the lowest speed.
        factor = hysteresis_factor(restitution, speed)
        assert_allclose(factor, hysteresis_factor(0.6, SPEED), rtol=2e-4)


def test_regression_restitution_at_another_speed_takes_one_bisection(monkeypatch):
    """A bisection in each step of a bisection took a quarter of a run with two contacts."""
    logarithms = []
    log = SimpleNamespace(log1p=math.log1p, log=lambda x: logarithms.append(x) or math.log(x))
    monkeypatch.setattr(contact, "math", log)
    restitution_at(1.0, 0.6, SPEED)
    assert 0 < len(logarithms) < 1000
