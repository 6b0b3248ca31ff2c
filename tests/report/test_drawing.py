"""Drawings of mechanisms: symbols, arrows and placement of labels."""

from itertools import pairwise

import numpy as np
import pytest
from conformance import JOINTS, LOADS, NONHOLONOMIC
from matplotlib.text import Text
from mechanisms import hinged_body
from numpy.testing import assert_allclose
from support import ARC, SOFT_MATERIAL

import beamdae as bd
from beamdae.report.scene.mechanism_scene import build_scene, reference_poses

SLOW = pytest.mark.slow(reason="half a second and more")
PARTS = JOINTS | NONHOLONOMIC | LOADS


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
