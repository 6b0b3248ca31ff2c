"""The drawing of a mechanism as it is stated."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from conformance import JOINTS, LOADS, NONHOLONOMIC
from matplotlib.text import Text
from numpy.testing import assert_allclose
from support import ARC, SOFT

import beamdae as bd
from beamdae.report.scene import poses
from beamdae.report.scene.mechanism_scene import build_scene

SLOW = pytest.mark.slow(reason="half a second and more")
EVERYTHING = JOINTS | NONHOLONOMIC | LOADS


def mechanism(gravity=(0.0, -9.81)):
    mech = bd.Mechanism(gravity=gravity)
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    beam = mech.add(bd.Beam("beam", ARC, bd.Section.circle(SOFT, 0.1), 3))
    return mech, disk, beam


def names(mech):
    (axis,) = mech.draw().figure.axes
    return {line for text in axis.texts for line in text.get_text().splitlines() if line}


def arrows(mech):
    """From where to where each arrow goes."""
    scene = build_scene(mech, poses.reference_poses, np.zeros(1))
    return [line[0] for glyph, line in scene.lines() if glyph.kind == "load"]


@pytest.mark.parametrize("make", EVERYTHING.values(), ids=EVERYTHING)
def test_whatever_there_is_is_drawn_with_its_name(make):
    mech, disk, beam = mechanism()
    part = mech.add(make(mech, disk, beam))
    seen = names(mech)
    assert {"disk", "beam", "9.81 m/s²"} <= seen
    # Damping all along a beam is nowhere.
    assert (part.name in seen) != isinstance(part, bd.RayleighDamping | bd.AirDrag)


def test_forces_point_where_they_push_and_end_where_they_act():
    for axes, law, along in [
        ("inertial", (3.0, 0.0), (1.0, 0.0)),
        ("inertial", (lambda t: -t, 0.0), (-1.0, 0.0)),
        # The axes of a body are those of the drawing, as it turns them.
        ("body", (0.0, 2.0), (0.0, 1.0)),
    ]:
        mech, _, beam = mechanism(gravity=(0.0, 0.0))
        place = beam.at(0.7)
        mech.add(bd.Force("load", place, law, axes))
        ((start, end),) = arrows(mech)
        assert_allclose(end, place.point, atol=1e-12)
        assert_allclose((end - start) / np.hypot(*(end - start)), along, atol=1e-12)


def test_names_of_one_place_stand_below_each_other():
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


def test_drawings_of_any_size_are_of_one_look():
    sizes = []
    for scale in (1e-6, 1.0, 1e6):
        mech = bd.Mechanism()
        bob = mech.add(bd.RigidBody("bob", 1.0, 0.1, (scale, 0.0)))
        mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
        figure = mech.draw().figure
        extent = figure.axes[0].dataLim.get_points() / scale
        sizes.append((*figure.get_size_inches(), *extent.ravel()))
    assert_allclose(sizes, [sizes[1]] * 3, rtol=1e-9)


@pytest.mark.parametrize(
    "name",
    [
        "governor",
        pytest.param("leaf_spring_vehicle", marks=SLOW),
        pytest.param("quick_return", marks=SLOW),
    ],
)
def test_names_do_not_lie_on_each_other(name):
    figure = bd.load_model(f"example:{name}")().draw().figure
    (axis,) = figure.axes
    figure.draw_without_rendering()
    # Without the lines that lead to what they name.
    boxes = [Text.get_window_extent(text) for text in axis.texts if text.get_text()]
    boxes = np.array([(*box.min, *box.max) for box in boxes])
    assert len(boxes) >= 9
    low, high = boxes[:, None, :2], boxes[:, None, 2:]
    common = np.minimum(high, boxes[None, :, 2:]) - np.maximum(low, boxes[None, :, :2])
    assert np.array_equal(np.all(common > 0.0, axis=-1), np.eye(len(boxes), dtype=bool))
    # All are within the picture.
    assert np.all(boxes[:, :2] > 0.0)
    assert np.all(boxes[:, 2:] < figure.get_size_inches() * figure.dpi)


@SLOW
def test_as_many_names_as_there_are_parts_in_a_dense_drawing():
    mech = bd.Mechanism()
    for k in range(20):
        place = 0.1 * np.cos(k), 0.1 * np.sin(2.0 * k)
        mech.add(bd.PointMass(f"point number {k}", 1.0, at=place))
    assert names(mech) == {f"point number {k}" for k in range(20)}


def test_what_has_nothing_to_draw_is_refused():
    with pytest.raises(bd.BeamdaeError, match="has no parts that could be drawn"):
        bd.Mechanism().draw()
    with pytest.raises(bd.BeamdaeError, match="draw: expected a mechanism, got 'leaf'"):
        bd.draw("leaf")


def test_names_are_no_formulas(tmp_path):
    mech = bd.Mechanism()
    mech.add(bd.PointMass("$x", 1.0, at=(0.0, 0.0)))
    mech.add(bd.PointMass("_y$", 1.0, at=(1.0, 0.0)))
    assert mech.draw().save(tmp_path / "points.png").stat().st_size > 1000
