"""Scenes of runs: bodies and symbols are where the observed columns say they are."""

import json

import numpy as np
import pytest
from conformance import JOINTS, LOADS, NONHOLONOMIC
from hub_beam import hub_beam
from numpy.testing import assert_allclose
from pendulum import pendulum
from slider_crank import slider_crank
from spin_up import spin_up
from support import ARC, SOFT

import beamdae as bd
from beamdae.report.scene import poses
from beamdae.report.scene.frame_export import export_run_frames
from beamdae.report.scene.mechanism_scene import SECTIONS, build_scene
from beamdae.report.scene.outlines import frame_times
from beamdae.report.scene.run_scene import build_run_scene

FRAMES = 11
T_END = 0.2


def run(mechanism, t_end=T_END):
    return bd.simulate(
        mechanism, bd.GeneralizedAlpha(5e-3), t_end, output_step=t_end / (FRAMES - 1)
    )


def seen(solution, kind=None, **settings):
    """By part and kind: where the points of its glyphs are, (frames, k, 2)."""
    scene = build_run_scene("test", solution, frame_times(solution, FRAMES), **settings)
    found = {}
    for glyph, line in scene.lines():
        found.setdefault((glyph.part, glyph.kind), []).append(line)
    return {key: np.concatenate(lines, axis=1) for key, lines in found.items()}


def bodies(solution):
    """By name: places of bodies (frame, point, 2), the middle of a particle."""
    found = seen(solution, left_out=lambda part: True)
    return {
        name: line[:, :-1].mean(axis=1, keepdims=True) if kind == "point" else line
        for (name, kind), line in found.items()
    }


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
    places = bodies(solution)
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
    beam = bodies(solution)["beam"]
    assert beam.shape == (FRAMES, SECTIONS, 2)
    columns = ["a third.x [m]", "a third.y [m]"]
    # The same states, at times that agree to rounding.
    assert_allclose(beam[:, SECTIONS // 3], solution.observed[columns], rtol=0, atol=1e-12)


def test_parts_look_as_their_kinds_do():
    found = seen(run(slider_crank()))
    assert {kind for part, kind in found if part == "bearing"} == {"joint"}
    for part, kind in [
        ("ground", "ground"),
        ("crank", "rigid"),
        ("rod", "beam"),
        ("slider", "point"),
        ("guide", "guide"),
        ("motor", "driver"),
    ]:
        assert (part, kind) in found


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
    places = bodies(run(mech))
    expected = {
        # Closed.
        "triangle": [(0.0, 0.0), (2.0, 0.0), (0.0, 2.0), (0.0, 0.0)],
        "bar": [(2.0, 0.0), (3.0, 0.0)],
        "bob": [(5.0, 5.0)],
    }
    found = {name: [tuple(p) for p in x[0].round(12)] for name, x in places.items()}
    assert found.pop("disk")
    assert found == expected
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
    assert bodies(solution)["beam"].shape[0] == FRAMES


EVERYTHING = JOINTS | NONHOLONOMIC | LOADS


def both():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(bd.Beam("beam", ARC, bd.Section.circle(SOFT, 0.1), 1))
    return mech, disk, beam


@pytest.mark.parametrize("make", EVERYTHING.values(), ids=EVERYTHING)
def test_a_drawing_is_the_first_frame_of_a_motion(make):
    mech, disk, beam = both()
    mech.add(make(mech, disk, beam))
    q = np.concatenate([part.initial_position for part in mech.parts.values()])
    drawn = build_scene(mech, poses.reference_poses, np.zeros(1))
    moved = build_scene(mech, poses.CoordinatePoses(mech, q[None]), np.zeros(1))
    assert [g.part for g in drawn.glyphs] == [g.part for g in moved.glyphs]
    for (glyph, line), (_, other) in zip(drawn.lines(), moved.lines(), strict=True):
        # Rounding, of the angles of the axis and of derivatives of shape functions.
        assert_allclose(line, other, rtol=0, atol=1e-9, err_msg=f"{glyph.part} {glyph.kind}")


def turned(points, angle, way):
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([(c, s), (-s, c)]) + way


# What has a direction or a load in the inertial frame, and the support under the ground.
UPRIGHT = {"load", "load tip", "ground"}


@pytest.mark.parametrize("make", EVERYTHING.values(), ids=EVERYTHING)
def test_symbols_move_with_a_mechanism_that_moves_as_a_whole(make):
    mech, disk, beam = both()
    mech.add(make(mech, disk, beam))
    q = np.concatenate([part.initial_position for part in mech.parts.values()])
    angle, way = 0.7, np.array([0.3, -0.2])
    # A disk and a beam in a floating frame: places first, then the angle.
    moved = q.copy()
    for part in (disk, beam):
        first = list(mech.parts.values()).index(part)
        at = sum(len(x.coordinates) for x in list(mech.parts.values())[:first])
        moved[at : at + 2] = turned(q[at : at + 2], angle, way)
        moved[at + 2] += angle
    scene = build_scene(mech, poses.CoordinatePoses(mech, np.array([q, moved])), np.zeros(2))
    grounded = {
        part.name
        for part in mech.parts.values()
        for place in part.attachments
        if place.body is mech.ground
    }
    for glyph, line in scene.lines():
        if glyph.part not in grounded and glyph.kind not in UPRIGHT:
            assert_allclose(line[1], turned(line[0], angle, way), rtol=0, atol=1e-12)


def test_springs_and_dampers_end_at_their_points_and_keep_their_width():
    mech = bd.Mechanism()
    ends = [mech.add(bd.PointMass(name, 1.0, at=(x, 0.0))) for name, x in (("a", 0.0), ("b", 1.0))]
    mech.add(bd.Spring("spring", ends[0].point, ends[1].point, 1.0))
    mech.add(bd.Damper("damper", ends[0].point, ends[1].point, 1.0))
    q = np.array([(0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.5)])
    scene = build_scene(mech, poses.CoordinatePoses(mech, q), np.zeros(2))
    lines = {glyph.kind: line for glyph, line in scene.lines()}
    for kind in ("spring", "damper"):
        finite = lines[kind][:, np.isfinite(lines[kind][0, :, 0])]
        assert_allclose(finite[:, [0, -1]], [[(0, 0), (1, 0)], [(0, 0), (0, 1.5)]], atol=1e-15)
        # Across the line, before and after a quarter turn and a stretch.
        assert_allclose(np.ptp(finite[0, :, 1]), np.ptp(finite[1, :, 0]), rtol=1e-12)
    # The piston stays in the cup.
    cup, piston = lines["damper"][:, 3:7], lines["damper"][:, 8:10]
    along = {0: 0, 1: 1}
    for frame, axis in along.items():
        inside = cup[frame, :, axis]
        assert inside.min() < piston[frame, 0, axis] < inside.max()


@pytest.mark.slow(reason="a quarter of a second")
def test_guides_are_as_long_as_the_way_that_is_gone():
    solution = run(slider_crank(), t_end=1.0)
    guide = seen(solution)["guide", "guide"]
    x = solution.observed["slider.x [m]"]
    ends = np.nanmin(guide[0, :, 0]), np.nanmax(guide[0, :, 0])
    assert ends[0] < x.min()
    assert ends[1] > x.max()


@pytest.mark.slow(reason="a quarter of a second")
def test_what_rolls_shows_that_it_turns():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.5, (0.0, 1.0), velocity=(2.0, 0.0)))
    roll = bd.RollingOnLine("roll", mech.ground.at(0.0, 0.0), disk.at(0.0, 1.0), radius=1.0)
    mech.add(roll)
    mech.observe("disk", disk.at(0.0, 1.0))
    solution = run(mech)
    rim = seen(solution)["roll", "wheel"]
    spoke = rim[:, -1] - rim[:, -2]
    angle = solution.observed["disk.angle [rad]"]
    assert angle.iloc[-1] < -0.2
    # Of a radius of one: times that agree to rounding.
    assert_allclose(spoke, np.stack([np.cos(angle), np.sin(angle)], axis=-1), atol=1e-12)


def test_arrows_are_as_long_as_their_load_is_of_its_largest():
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    mech.add(bd.Force("push", ball.point, (lambda t: 10.0 * t, 0.0)))
    arrow = seen(run(mech))["push", "load"]
    length = np.hypot(*(arrow[:, 1] - arrow[:, 0]).T)
    assert np.isnan(length[0])
    assert_allclose(length[1:] / length[-1], np.linspace(0.0, 1.0, FRAMES)[1:], rtol=1e-12)
    # Nothing but standard JSON.
    assert json.loads(json.dumps(export_run_frames(run(mech)), allow_nan=False))


@pytest.mark.slow(reason="a quarter of a second")
def test_loads_by_laws_of_the_motion_point_where_they_push():
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.5)))
    mech.add(bd.ForceLaw("drag", ball.point, lambda b, t: -0.5 * b.velocity, dissipative=True))
    arrow = seen(run(mech))["drag", "load"]
    way = arrow[:, 1] - arrow[:, 0]
    assert_allclose(way[:, 1] / way[:, 0], 0.5, rtol=1e-9)
    assert np.all(way[:, 0] < 0.0)
