"""Drawings and scenes of mechanisms: symbols, poses and labels."""

import json
from itertools import pairwise

import numpy as np
import pytest
from conformance import JOINTS, LOADS, NONHOLONOMIC
from hub_beam import hub_beam
from matplotlib.text import Text
from mechanisms import EARTH, clamped_beam, free_ball, hinged_body, mass_on_rail, rectangle
from numpy.testing import assert_allclose
from pendulum import pendulum
from slider_crank import slider_crank
from spin_up import spin_up
from support import ARC, SOFT_MATERIAL

import beamdae as bd
from beamdae.report.page.content import encode
from beamdae.report.scene.mechanism_scene import (
    MAX_BEAM_SECTIONS,
    build_scene,
    coordinate_poses,
    reference_poses,
)
from beamdae.report.scene.run_scene import build_run_scene, export_run_frames, frame_times

FRAMES = 11
T_END = 0.2


def simulate(mechanism, t_end=T_END):
    return bd.simulate(
        mechanism, bd.GeneralizedAlpha(5e-3), t_end, output_step=t_end / (FRAMES - 1)
    )


def scene_lines(solution, **settings):
    """Return the points of all glyphs by part and kind, (frames, k, 2)."""
    scene = build_run_scene("test", solution, frame_times(solution, FRAMES), **settings)
    groups = {}
    for glyph, line in scene.lines():
        groups.setdefault((glyph.part, glyph.kind), []).append(line)
    return {key: np.concatenate(lines, axis=1) for key, lines in groups.items()}


def body_points(solution):
    """Return the points of bodies by name, (frames, k, 2); the center of a particle."""
    lines = scene_lines(solution, is_hidden=lambda part: True)
    return {
        name: line[:, :-1].mean(axis=1, keepdims=True) if kind == "point" else line
        for (name, kind), line in lines.items()
    }


# Model, parameters, and triples of an observable, a body and the index of its point.
OBSERVED_POINTS = [
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
    ("model", "parameters", "points"),
    OBSERVED_POINTS,
    ids=[f"{model.name}-{parameters}" for model, parameters, _ in OBSERVED_POINTS],
)
def test_bodies_are_at_the_observed_positions(model, parameters, points):
    mechanism = model(**parameters)
    solution = simulate(mechanism)
    lines = body_points(solution)
    assert {"ground", "joint"} <= {kind for _, kind in scene_lines(solution)}
    for observable, body, point in points:
        columns = [f"{observable}.x [m]", f"{observable}.y [m]"]
        # The same point, or one joined to it: they differ by rounding and the drift of the joint.
        drift = solution.quality.max_position_drift
        assert drift < 1e-5
        assert_allclose(
            lines[body][:, point], solution.observed[columns], rtol=0, atol=drift + 1e-12
        )


def create_linkage():
    """Build a triangle with three joints, a bar with one, a disk with one at its center, a bob."""
    mech, triangle = hinged_body(1.0, 0.1, center=(1.0, 1.0), name="triangle", gravity=9.81)
    bar = mech.add(bd.RigidBody("bar", 1.0, 0.1, center=(3.0, 0.0)))
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.1, center=(0.0, 2.0)))
    mech.add(bd.Revolute("pin", triangle.at(2.0, 0.0), bar.at(2.0, 0.0)))
    mech.add(bd.Revolute("axle", triangle.at(0.0, 2.0), disk.at(0.0, 2.0)))
    mech.add(bd.Force("push", triangle.at(2.0, 0.0), (0.0, 1.0)))
    mech.add(bd.PointMass("bob", 1.0, at=(5.0, 5.0)))
    return mech


def test_rigid_bodies_are_drawn_through_their_attachments():
    lines = body_points(simulate(create_linkage()))
    expected = {
        # The outline is closed.
        "triangle": [(0.0, 0.0), (2.0, 0.0), (0.0, 2.0), (0.0, 0.0)],
        "bar": [(2.0, 0.0), (3.0, 0.0)],
        "bob": [(5.0, 5.0)],
    }
    first = {name: [tuple(p) for p in x[0].round(12)] for name, x in lines.items()}
    assert first.pop("disk")
    assert first == expected
    # The integrator follows free fall up to rounding, and the triangle is rigid.
    assert_allclose(lines["bob"][-1, 0, 1], 5.0 - 0.5 * 9.81 * T_END**2, atol=1e-6)
    hypotenuse = np.hypot(*(lines["triangle"][:, 2] - lines["triangle"][:, 1]).T)
    assert_allclose(hypotenuse, np.sqrt(8.0), rtol=1e-14)


PARTS = JOINTS | NONHOLONOMIC | LOADS


def create_disk_and_beam():
    mech = bd.Mechanism(gravity=EARTH)
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(bd.Beam("beam", ARC, bd.Section.circle(SOFT_MATERIAL, 0.1), 1))
    return mech, disk, beam


@pytest.mark.parametrize(
    ("body", "place", "edge"),
    [
        (bd.RigidBody.plate("body", (0.0, 0.0), 0.2, 0.1, mass=1.0), (0.02, 0.5), (0.02, 0.05)),
        (bd.RigidBody.disk("body", (0.0, 0.0), 0.1, mass=1.0), (0.0, 0.5), (0.0, 0.1)),
        (bd.RigidBody.rod("body", (-0.3, 0.0), (0.3, 0.0), mass=1.0), (0.0, 0.5), (0.0, 0.0)),
    ],
    ids=["plate", "disk", "rod"],
)
def test_joints_outside_the_outline_of_a_body_are_joined_to_it(body, place, edge):
    """A counterweight below its pin was drawn without a connection."""
    mech = bd.Mechanism()
    mech.add(body)
    mech.add(bd.Revolute("pin", mech.ground.at(*place), body.at(*place)))
    mech.add(bd.Spring("inside", mech.ground.at(0.0, -1.0), body.at(0.0, 0.0), 1.0))
    scene = build_scene(mech, reference_poses, np.zeros(1))
    lines = {(glyph.part, glyph.kind): line for glyph, line in scene.lines()}
    outline = lines["body", "rigid"][0]
    (k,) = np.flatnonzero(np.hypot(*(outline - place).T) < 1e-9)
    assert_allclose(outline[[k - 1, k + 1]], [edge, edge], atol=1e-3)


def test_a_drawing_equals_the_first_frame_of_an_animation():
    for make in PARTS.values():
        mech, disk, beam = create_disk_and_beam()
        mech.add(make(mech, disk, beam))
        q = np.concatenate([part.initial_position for part in mech.parts.values()])
        drawing = build_scene(mech, reference_poses, np.zeros(1))
        first_frame = build_scene(mech, coordinate_poses(mech, q[None]), np.zeros(1))
        assert [g.part for g in drawing.glyphs] == [g.part for g in first_frame.glyphs]
        for (glyph, line), (_, other) in zip(drawing.lines(), first_frame.lines(), strict=True):
            # Rounding of angles of the axis and of derivatives of shape functions.
            assert_allclose(line, other, rtol=0, atol=1e-9, err_msg=f"{glyph.part} {glyph.kind}")
            # The line of a gear joins its points, which coincide here.
            if glyph.kind != "gear":
                corners = np.unique(line[0][np.isfinite(line[0, :, 0])], axis=0)
                assert len(corners) > 1, f"{glyph.part} {glyph.kind}"


def test_pictures_of_modes_show_the_whole_mechanism():
    for axis in bd.modes(pendulum(), n=2).plot().figure.axes:
        assert np.all(np.abs(axis.transLimits.transform(axis.dataLim) - 0.5) < 0.5)


def test_springs_and_dampers_end_at_their_points_and_keep_their_width():
    mech = bd.Mechanism()
    ends = [mech.add(bd.PointMass(name, 1.0, at=(x, 0.0))) for name, x in (("a", 0.0), ("b", 1.0))]
    mech.add(bd.Spring("spring", ends[0].point, ends[1].point, 1.0))
    mech.add(bd.Spring("damper", ends[0].point, ends[1].point, damping=1.0))
    q = np.array([(0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.5)])
    scene = build_scene(mech, coordinate_poses(mech, q), np.zeros(2))
    lines = {glyph.kind: line for glyph, line in scene.lines()}
    for kind in ("spring", "damper"):
        finite = lines[kind][:, np.isfinite(lines[kind][0, :, 0])]
        assert_allclose(finite[:, [0, -1]], [[(0, 0), (1, 0)], [(0, 0), (0, 1.5)]], atol=1e-15)
        # Width, before and after a rotation by a quarter turn and a stretch.
        assert_allclose(np.ptp(finite[0, :, 1]), np.ptp(finite[1, :, 0]), rtol=1e-12)


def test_bars_join_a_spring_and_a_damper_side_by_side():
    mech, bob = mass_on_rail(1.0, 1.0)
    mech.add(bd.Spring("strut", mech.ground.at(0.0, 0.0), bob.point, 1.0, damping=1.0))
    scene = build_scene(mech, reference_poses, np.zeros(1))
    coil, dashpot, bars = (line[0] for glyph, line in scene.lines() if glyph.part == "strut")
    for line in (coil, dashpot):
        for end in (line[0], line[-1]):
            bar = bars[np.isclose(bars[:, 0], end[0]), 1]
            assert bar.min() <= end[1] <= bar.max()


def move_rigidly(points, angle, translation):
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([(c, s), (-s, c)]) + translation


# Loads with inertial directions, and supports of the ground.
NOT_MOVING_RIGIDLY = {"load", "load tip", "ground"}


@pytest.mark.parametrize("make", PARTS.values(), ids=PARTS)
def test_symbols_follow_a_rigid_motion_of_the_mechanism(make):
    mech, disk, beam = create_disk_and_beam()
    mech.add(make(mech, disk, beam))
    q = np.concatenate([part.initial_position for part in mech.parts.values()])
    angle, translation = 0.7, np.array([0.3, -0.2])
    # Coordinates of the disk and of the floating frame of the beam: position, then angle.
    displaced = q.copy()
    for part in (disk, beam):
        first = list(mech.parts.values()).index(part)
        at = sum(len(x.coordinates) for x in list(mech.parts.values())[:first])
        displaced[at : at + 2] = move_rigidly(q[at : at + 2], angle, translation)
        displaced[at + 2] += angle
    scene = build_scene(mech, coordinate_poses(mech, np.array([q, displaced])), np.zeros(2))
    grounded = {
        part.name
        for part in mech.parts.values()
        for attachment in part.attachments
        if attachment.body is mech.ground
    }
    for glyph, line in scene.lines():
        if glyph.part not in grounded and glyph.kind not in NOT_MOVING_RIGIDLY:
            assert_allclose(line[1], move_rigidly(line[0], angle, translation), rtol=0, atol=1e-12)


@pytest.mark.slow(reason="a quarter of a second")
def test_guides_cover_the_travel_of_the_slider():
    solution = simulate(slider_crank(), t_end=1.0)
    guide = scene_lines(solution)["guide", "guide"]
    x = solution.observed["slider.x [m]"]
    ends = np.nanmin(guide[0, :, 0]), np.nanmax(guide[0, :, 0])
    assert ends[0] < x.min()
    assert ends[1] > x.max()


@pytest.mark.slow(reason="a quarter of a second")
def test_the_spoke_of_a_rolling_disk_rotates():
    mech = bd.Mechanism(gravity=EARTH)
    disk = mech.add(bd.RigidBody("disk", 1.0, 0.5, (0.0, 1.0), velocity=(2.0, 0.0)))
    roll = bd.RollingOnLine("roll", mech.ground.at(0.0, 0.0), disk.at(0.0, 1.0), radius=1.0)
    mech.add(roll)
    mech.observe("disk", disk.at(0.0, 1.0))
    solution = simulate(mech)
    rim = scene_lines(solution)["roll", "wheel"]
    spoke = rim[:, -1] - rim[:, -2]
    angle = solution.observed["disk.angle [rad]"]
    assert angle.iloc[-1] < -0.2
    # The radius is 1 m; the times agree to rounding.
    assert_allclose(spoke, np.stack([np.cos(angle), np.sin(angle)], axis=-1), atol=1e-12)


def test_pitch_circles_of_gears_touch():
    mech = bd.Mechanism()
    a, b = (mech.add(bd.RigidBody(str(x), 1.0, 1.0, (x, 0.0))) for x in (0.0, 3.0))
    mech.add(bd.Gear("gear", a.at(0.0, 0.0), b.at(3.0, 0.0), ratio=-0.5))
    scene = build_scene(mech, reference_poses, np.zeros(1))
    _, *circles = (line[0] for glyph, line in scene.lines() if glyph.kind == "gear")
    ends = [(np.nanmin(x[:, 0]), np.nanmax(x[:, 0])) for x in circles]
    assert_allclose(ends, [(-1.0, 1.0), (1.0, 5.0)], atol=1e-12)


def test_arrows_have_the_direction_and_the_relative_size_of_the_load():
    mech, ball = free_ball()
    mech.add(bd.Force("push", ball.point, (lambda t: 10.0 * t, 0.0)))
    glider = mech.add(bd.PointMass("glider", 1.0, at=(0.0, 1.0), velocity=(1.0, 0.5)))
    mech.add(bd.ForceLaw("drag", glider.point, lambda b, t: -0.5 * b.velocity, dissipative=True))
    solution = simulate(mech)
    push, drag = (
        np.diff(scene_lines(solution)[x, "load"][:, :2], axis=1) for x in ("push", "drag")
    )
    length = np.hypot(*push[:, 0].T)
    assert np.isnan(length[0])
    assert_allclose(length[1:] / length[-1], np.linspace(0.0, 1.0, FRAMES)[1:], rtol=1e-12)
    assert_allclose(drag[:, 0, 1] / drag[:, 0, 0], 0.5, rtol=1e-9)
    assert np.all(drag[:, 0, 0] < 0.0)
    # The exported scene is standard JSON.
    assert json.loads(encode(export_run_frames(solution)))


def leaf(heights, width=0.3):
    """Return a clamped leaf of varying thickness and a strut of constant thickness."""

    def section(s):
        return rectangle(heights[0] + s * heights[1], material=SOFT_MATERIAL)

    mech, _ = clamped_beam(section, 2, (0.0, width), name="leaf")
    strut = rectangle(0.005, material=SOFT_MATERIAL)
    mech.add(bd.Beam("strut", bd.Line((0.1, 0.0), (0.1, 0.3)), strut, elements=1))
    return mech


def drawn_curves(mechanism):
    scene = build_scene(mechanism, reference_poses, np.zeros(1))
    return scene, {x.part: x for x in scene.glyphs if x.kind.startswith("beam")}


def test_beams_are_drawn_with_the_heights_of_varying_sections():
    scene, curves = drawn_curves(leaf((0.01, 0.02)))
    assert scene.caption == ""
    (leaf_outline,), (strut,) = (curves[x].positions for x in ("leaf", "strut"))
    k = MAX_BEAM_SECTIONS
    assert leaf_outline.shape == (2 * k + 1, 2)
    assert_allclose(leaf_outline[0], leaf_outline[-1])
    heights = np.hypot(*(leaf_outline[:k] - leaf_outline[k:-1][::-1]).T)
    assert_allclose(heights[[0, -1]], [0.01, 0.016])
    assert_allclose(np.hypot(*(strut[:k] - strut[k:-1][::-1]).T), 0.005)
    assert_allclose(leaf_outline[[0, k - 1]], [(-0.005, 0.0), (-0.008, 0.3)], atol=1e-12)


def test_beams_of_constant_sections_and_unknown_heights_are_lines():
    for mechanism in (pendulum(), unknown_heights()):
        scene, curves = drawn_curves(mechanism)
        assert {x.kind for x in curves.values()} == {"beam"}
        assert scene.caption == ""


def unknown_heights():
    section = bd.Section(SOFT_MATERIAL, area=1e-4, second_moment=1e-10)
    mechanism = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    mechanism.add(bd.Beam("beam", line, lambda s: section, elements=1))
    return mechanism


SLOW = pytest.mark.slow(reason="half a second and more")


def create_mechanism(gravity=(0.0, -9.81)):
    mech = bd.Mechanism(gravity=gravity)
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(bd.Beam("beam", ARC, bd.Section.circle(SOFT_MATERIAL, 0.1), 3))
    return mech, disk, beam


def find_names(mech):
    (axis,) = mech.draw().figure.axes
    return {line for text in axis.texts for line in text.get_text().splitlines() if line}


def find_arrows(mech):
    """Return tail and head of each arrow."""
    scene = build_scene(mech, reference_poses, np.zeros(1))
    return [line[0] for glyph, line in scene.lines() if glyph.kind == "load"]


@pytest.mark.parametrize("make", PARTS.values(), ids=PARTS)
def test_every_kind_of_part_is_drawn_with_its_name(make):
    mech, disk, beam = create_mechanism()
    part = mech.add(make(mech, disk, beam))
    names = find_names(mech)
    assert {"disk", "beam", "9.81 m/s²"} <= names
    # Damping distributed along a beam has no symbol.
    distributed = bd.RayleighDamping | bd.AirDrag | bd.StandardLinearSolid
    assert (part.name in names) != isinstance(part, distributed)


def test_forces_point_where_they_push_and_end_where_they_act():
    for axes, law, direction in [
        ("inertial", (3.0, 0.0), (1.0, 0.0)),
        ("inertial", (lambda t: -t, 0.0), (-1.0, 0.0)),
        # In the drawing, the axes of a body are parallel to the inertial frame.
        ("body", (0.0, 2.0), (0.0, 1.0)),
    ]:
        mech, _, beam = create_mechanism(gravity=(0.0, 0.0))
        place = beam.at(0.7)
        mech.add(bd.Force("load", place, law, axes))
        ((start, end),) = find_arrows(mech)
        assert_allclose(end, place.point, atol=1e-12)
        assert_allclose((end - start) / np.hypot(*(end - start)), direction, atol=1e-12)


def test_names_at_one_point_share_a_label():
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", 1.0, 0.1, (1.0, 0.0)))
    for name in ("hinge", "motor"):
        kind = {"hinge": bd.Revolute, "motor": bd.Driver}[name]
        law = () if name == "hinge" else (lambda t: t,)
        mech.add(kind(name, mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0), *law))
    (axis,) = mech.draw().figure.axes
    texts = [text for text in axis.texts if text.get_text()]
    assert sorted(text.get_text() for text in texts) == ["bob", "hinge\nmotor"]
    places = [np.array(text.xy) for text in texts]
    assert all(np.hypot(*(a - b)) > 0.03 for a, b in pairwise(places))


def test_drawings_do_not_depend_on_the_size_of_the_mechanism():
    sizes = []
    for scale in (1e-6, 1.0, 1e6):
        mech, _ = hinged_body(1.0, 0.1, (scale, 0.0), name="bob")
        figure = mech.draw().figure
        extent = figure.axes[0].dataLim.get_points() / scale
        sizes.append((*figure.get_size_inches(), *extent.ravel()))
    assert_allclose(sizes, [sizes[1]] * 3, rtol=1e-9)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "name",
    [
        "governor",
        pytest.param("leaf_spring_vehicle", marks=SLOW),
        pytest.param("quick_return", marks=SLOW),
    ],
)
def test_labels_do_not_overlap(name):
    figure = bd.load_model(f"example:{name}")().draw().figure
    (axis,) = figure.axes
    figure.draw_without_rendering()
    # The boxes of the texts, without the lines that connect them to their points.
    boxes = [Text.get_window_extent(text) for text in axis.texts if text.get_text()]
    boxes = np.array([(*box.min, *box.max) for box in boxes])
    assert len(boxes) >= 9
    low, high = boxes[:, None, :2], boxes[:, None, 2:]
    common = np.minimum(high, boxes[None, :, 2:]) - np.maximum(low, boxes[None, :, :2])
    assert np.array_equal(np.all(common > 0.0, axis=-1), np.eye(len(boxes), dtype=bool))
    # All labels are inside the figure.
    assert np.all(boxes[:, :2] > 0.0)
    assert np.all(boxes[:, 2:] < figure.get_size_inches() * figure.dpi)


@SLOW
def test_a_dense_drawing_shows_all_names():
    mech = bd.Mechanism()
    for k in range(20):
        place = 0.1 * np.cos(k), 0.1 * np.sin(2.0 * k)
        mech.add(bd.PointMass(f"point number {k}", 1.0, at=place))
    assert find_names(mech) == {f"point number {k}" for k in range(20)}


def test_mechanisms_without_parts_are_rejected():
    with pytest.raises(bd.BeamdaeError, match="has no parts that can be drawn"):
        bd.Mechanism().draw()


def test_names_with_dollar_signs_are_drawn_literally(tmp_path):
    mech = bd.Mechanism()
    mech.add(bd.PointMass("$x", 1.0, at=(0.0, 0.0)))
    mech.add(bd.PointMass("_y$", 1.0, at=(1.0, 0.0)))
    assert mech.draw().save(tmp_path / "points.png").stat().st_size > 1000
