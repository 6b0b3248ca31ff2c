"""Steps do not pass over what begins and ends between two of them, however short it is."""

import casadi as ca
import numpy as np
import pytest

import beamdae as bd

METHODS = [bd.Radau(1e-5), bd.Ida(1e-5), bd.Auto(1e-5)]
ANY_METHOD = pytest.mark.parametrize("method", METHODS, ids=lambda x: x.label.split("(")[0])
# Unit shapes and their integrals.
SHAPES = {
    "gauss": (lambda x: ca.exp(-(x**2)), np.sqrt(np.pi)),
    "box": (lambda x: ca.if_else(ca.fabs(x) < 1.0, 1.0, 0.0), 2.0),
    "tent": (lambda x: ca.fmax(0.0, 1.0 - ca.fabs(x)), 1.0),
    "well": (lambda x: 1.0 / (1.0 + x**4), np.pi / np.sqrt(2.0)),
}


def draw(seed):
    """Return the width and the place, relative to the run, and an impulse."""
    random = np.random.default_rng(seed)
    width, place = 10.0 ** random.uniform(-6.0, -1.5), random.uniform(0.2, 0.8)
    return width, place, 10.0 ** random.uniform(-2.0, 0.5)


def moving_ball(height=0.0):
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, height), velocity=(1.0, 0.0)))
    mech.observe("ball", ball.point)
    return mech, ball


@ANY_METHOD
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(2))
def test_regression_forces_in_narrow_places_have_their_impulse(method, shape, seed):
    """Places narrower than a thousandth of the motion had no effect."""
    width, place, impulse = draw(seed)
    function, integral = SHAPES[shape]
    mech, ball = moving_ball()
    x = mech.sensor("x", ball.point, "x")
    force = impulse / (integral * width) * function((x - place) / width)
    mech.add(bd.Force("blow", ball.point, (0.0, force)))
    run = bd.simulate(mech, method, t_end=1.0)
    assert run["ball.y_dot"].iloc[-1] == pytest.approx(impulse, rel=5e-3)


@ANY_METHOD
@pytest.mark.parametrize("seed", range(4))
def test_regression_events_in_narrow_places_are_recorded(method, seed):
    width, place, _ = draw(seed)
    mech, ball = moving_ball(0.3 * width)
    circle = bd.CircleSurface(mech.ground.at(place, 0.0), 0.5 * width, "outside")
    mech.when(circle.gap(ball.point), crosses=0.0, do="record", name="inside")
    events = bd.simulate(mech, method, t_end=1.0).events
    assert events["t [s]"].to_numpy() == pytest.approx(place + 0.4 * width * np.array([-1, 1]))


@ANY_METHOD
@pytest.mark.parametrize("seed", range(4))
def test_regression_runs_end_where_an_argument_leaves_a_table_for_a_short_time(method, seed):
    """The run continued if the argument was inside the table at the ends of all steps."""
    width, place, _ = draw(seed)
    mech, ball = moving_ball(0.3 * width)
    table = bd.table([0.5 * width, 1.0, 20.0], [0.0, 0.0, 0.0], "linear", "error")

    def force(ball, t):
        x, y = ball.position[0] - place, ball.position[1]
        return table(ca.sqrt(x**2 + y**2)), 0.0

    mech.add(bd.ForceLaw("spring", ball.point, force))
    run = bd.simulate(mech, method, t_end=1.0)
    assert run.status.kind == "limited"
    assert run.trajectory.end == pytest.approx(place - 0.4 * width, rel=1e-9)
