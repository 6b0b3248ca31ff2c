"""Shapes for an animation: they are where the observed columns say the bodies are."""

import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_allclose
from pendulum import pendulum
from slider_crank import slider_crank
from spin_up import spin_up

import beamdae as bd
from beamdae.results.shapes import frame_times, shapes

FRAMES = 11
T_END = 0.2


def run(mechanism, t_end=T_END):
    return bd.simulate(
        mechanism, bd.GeneralizedAlpha(5e-3), t_end, output_step=t_end / (FRAMES - 1)
    )


def drawn(mechanism, solution, **settings):
    """By name: places (frame, point, 2)."""
    bodies = shapes(mechanism, solution, **{"frames": FRAMES, **settings})
    assert len({body["name"] for body in bodies}) == len(bodies)
    return {body["name"]: np.stack([body["x"], body["y"]], axis=-1) for body in bodies}


# Observable, body and which of its points.
SEEN = [
    (hub_beam, {}, [("tip", "beam", -1), ("hub", "hub", 0)]),
    (hub_beam, {"bodies": 2, "elements": 4}, [("tip", "beam 2", -1)]),
    (
        pendulum,
        {},
        [("tip", "beam", -1), ("frame", "beam", 0), ("tip", "tip mass", 0)],
    ),
    (
        slider_crank,
        {},
        [("slider", "rod", -1), ("rod frame", "rod", 0), ("slider", "slider", 0)],
    ),
    (slider_crank, {"crank": "flexible"}, [("rod frame", "crank", -1)]),
    (spin_up, {}, [("tip", "beam", -1)]),
]


@pytest.mark.parametrize(
    ("model", "parameters", "seen"), SEEN, ids=[f"{m.name}-{p}" for m, p, _ in SEEN]
)
def test_shapes_are_where_the_observed_columns_are(model, parameters, seen):
    mechanism = model(**parameters)
    solution = run(mechanism)
    places = drawn(mechanism, solution)
    for observable, body, point in seen:
        columns = [f"{observable}.x [m]", f"{observable}.y [m]"]
        # The same point, or one joined to it: rounding, and the drift of the joint.
        drift = solution.quality.max_position_drift
        assert drift < 1e-5
        assert_allclose(
            places[body][:, point], solution.observed[columns], rtol=0, atol=drift + 1e-12
        )


def test_a_beam_is_drawn_through_sections_of_equal_arc_length():
    mechanism = pendulum()
    mechanism.observe("a third", mechanism.part("beam").at(0.8 / 3.0))
    solution = run(mechanism)
    beam = drawn(mechanism, solution, points=4)["beam"]
    columns = ["a third.x [m]", "a third.y [m]"]
    # The same states, at times that agree to rounding.
    assert_allclose(beam[:, 1], solution.observed[columns], rtol=0, atol=1e-12)


def test_kinds_and_order_are_those_of_the_parts():
    mechanism = slider_crank()
    bodies = shapes(mechanism, run(mechanism), frames=3)
    assert [(b["name"], b["kind"], np.shape(b["x"])) for b in bodies] == [
        ("ground", "ground", (3, 2)),
        ("crank", "rigid", (3, 2)),
        ("rod", "beam", (3, 13)),
        ("slider", "point", (3, 1)),
    ]
    assert bodies[0]["x"] == [[0.0, 5.0]] * 3
    assert bodies[0]["y"] == [[0.0, 0.0]] * 3


def linkage():
    """A triangle with three points in use, a bar with one, a disk with its center, a free bob."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    triangle = mech.add(bd.RigidBody("triangle", 1.0, 0.1, center=(1.0, 1.0)))
    bar = mech.add(bd.RigidBody("bar", 1.0, 0.1, center=(3.0, 0.0)))
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.1, center=(0.0, 2.0)))
    mech.add(bd.Revolute("pivot", mech.ground.at(0.0, 0.0), triangle.at(0.0, 0.0)))
    mech.add(bd.Revolute("hinge", triangle.at(2.0, 0.0), bar.at(2.0, 0.0)))
    mech.add(bd.Revolute("axle", triangle.at(0.0, 2.0), disk.at(0.0, 2.0)))
    mech.add(bd.Force("push", triangle.at(2.0, 0.0), (0.0, 1.0)))
    mech.add(bd.PointMass("bob", 1.0, at=(5.0, 5.0)))
    return mech


def test_rigid_bodies_are_drawn_through_the_points_in_use():
    mech = linkage()
    places = drawn(mech, run(mech))
    expected = {
        "ground": [(0.0, 0.0)],
        "triangle": [(0.0, 0.0), (2.0, 0.0), (0.0, 2.0)],
        "bar": [(2.0, 0.0), (3.0, 0.0)],
        "disk": [(0.0, 2.0)],
        "bob": [(5.0, 5.0)],
    }
    assert {name: [tuple(p) for p in x[0].round(12)] for name, x in places.items()} == expected
    # Free fall, which the steps follow but for rounding; rigid: rounding.
    assert_allclose(places["bob"][-1, 0, 1], 5.0 - 0.5 * 9.81 * T_END**2, atol=1e-6)
    hypotenuse = np.hypot(*(places["triangle"][:, 2] - places["triangle"][:, 1]).T)
    assert_allclose(hypotenuse, np.sqrt(8.0), rtol=1e-14)


def test_a_run_that_broke_off_is_drawn_as_far_as_it_got():
    mechanism = pendulum()
    solution = bd.simulate(mechanism, bd.Ida(1e-4, max_steps=50), t_end=5.0)
    assert not solution.status.success
    times = frame_times(solution, FRAMES)
    assert_allclose(times, np.linspace(0.0, solution.trajectory.end, FRAMES), rtol=1e-15)
    assert drawn(mechanism, solution)["beam"].shape == (FRAMES, 13, 2)


def test_the_solution_of_another_mechanism_is_refused():
    with pytest.raises(bd.BeamdaeError, match=r"^shapes: the solution is not one of this"):
        shapes(pendulum(elements=2), run(pendulum(elements=1)))
