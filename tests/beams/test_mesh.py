"""Nodes on the curve, errors of the interpolated axes, and floating frame operators."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import ARC, VARIANTS

import beamdae as bd
from beamdae.beams.floating_frame.element import FRAME_SIZE, NODE_SIZE

SECTION = VARIANTS[0].section
CURVES = {
    "arc": ARC,
    "right arc": bd.Arc(radius=-0.9, length=2.5, start=(1.0, 2.0), angle=2.0),
    "shallow parabola": bd.Parabola(span=4.0, rise=0.2, start=(1.0, 0.0), angle=0.5),
    "parabola": bd.Parabola(span=4.0, rise=1.0),
}
every_curve = pytest.mark.parametrize("curve", CURVES.values(), ids=list(CURVES))
every_shape = pytest.mark.parametrize("shape", ["curved", "straight"])
every_continuity = pytest.mark.parametrize(
    ("shape", "continuity", "nodes"),
    [
        ("curved", "cartesian", 4),
        ("curved", "local", 4),
        ("straight", "cartesian", 4),
        ("curved", "cartesian", 3),
        ("straight", "cartesian", 2),
    ],
)
every_frame = pytest.mark.parametrize("frame", ["tangent", "chord"])
every_count = pytest.mark.parametrize("nodes", [2, 3, 4])


def create_beam(
    curve,
    elements,
    shape="curved",
    frame="tangent",
    quadrature="reduced",
    continuity="cartesian",
    nodes=4,
):
    return bd.Beam(
        "beam",
        curve,
        SECTION,
        elements=elements,
        elements_shape=shape,
        continuity=continuity,
        frame=frame,
        quadrature=quadrature,
        nodes=nodes,
    )


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def mesh_errors(body):
    """Return the largest relative error of arc length and error of curvature times length."""
    names = ("largest relative error of arc length", "largest error of curvature times length")
    return tuple(body.facts[name] for name in names)


@pytest.mark.parametrize("quadrature", ["reduced", "full"])
@every_curve
def test_mesh_errors_of_curved_elements(curve, quadrature):
    """Arc length converges with fourth order, curvature with second.

    Arc of 72 degrees, 2 to 32 elements: length 2.3e-5, 1.5e-6, 9.2e-8, 5.7e-9, 3.6e-10; curvature
    times length at 3 points 2.5e-2, 6.3e-3, 1.6e-3, 4.0e-4, 9.9e-5.
    """
    errors = [mesh_errors(create_beam(curve, n, quadrature=quadrature)) for n in (16, 32, 64)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    # Rounding errors of lengths are 1e-14; the smallest error is at least 1e-12.
    assert_allclose(orders[:, 0], 4.0, atol=0.1)
    assert_allclose(orders[:, 1], 2.0, atol=0.1)


@pytest.mark.parametrize("quadrature", ["reduced", "full"])
@every_curve
def test_mesh_errors_of_quadratic_elements(curve, quadrature):
    """Arc length converges with fourth order, curvature with first order (second on an arc).

    The error of quadratic interpolation is h^3 xi (xi^2 - 1) / 48 times the third derivative. This
    function is odd in xi, so the length of an element has an error of the next order. The second
    derivative of the error across the axis is h xi / 2 times the derivative of the curvature, which
    is zero on an arc. Parabola with 16, 32, 64 elements at 2 points: length 3.2e-7, 2.0e-8, 1.3e-9;
    curvature times length 7.5e-2, 3.7e-2, 1.9e-2.
    """
    errors = [
        mesh_errors(create_beam(curve, n, quadrature=quadrature, nodes=3)) for n in (16, 32, 64)
    ]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    # Rounding errors of lengths are 1e-14; the smallest error is at least 5e-13.
    assert_allclose(orders[:, 0], 4.0, atol=0.1)
    assert_allclose(orders[:, 1], 2.0 if isinstance(curve, bd.Arc) else 1.0, atol=0.1)


@pytest.mark.parametrize("quadrature", ["reduced", "full"])
@every_frame
@every_curve
def test_elements_of_two_nodes_are_straight(curve, frame, quadrature):
    curved, straight = (
        create_beam(curve, 5, shape, frame, quadrature, nodes=2) for shape in ("curved", "straight")
    )
    gravity = np.zeros(2)
    # Rounding errors only.
    for actual, expected in [
        (curved.kinematics.operator.toarray(), straight.kinematics.operator.toarray()),
        (
            curved.kinematics.data(gravity),
            straight.kinematics.data(gravity),
        ),
        (mesh_errors(curved), mesh_errors(straight)),
        (curved.mesh.length_error, create_beam(curve, 5, "straight", frame).mesh.length_error),
    ]:
        assert_allclose(actual, expected, rtol=1e-12, atol=1e-13)


def test_elements_of_two_nodes_meet_at_kinks():
    match = "beam: continuity='local' requires .* meet at kinks; set continuity='cartesian'"
    with pytest.raises(bd.BeamdaeError, match=match):
        create_beam(ARC, 2, continuity="local", nodes=2)
    assert create_beam(ARC, 2, continuity="local", nodes=3).kinematics.continuity == "local"


def test_mesh_errors_of_an_arc():
    length_error, curvature_error = mesh_errors(create_beam(bd.Arc(radius=1.6, length=2.0), 8))
    # Measured; errors in the nodes or shape functions change these by factors.
    assert_allclose(length_error, 9.19e-8, rtol=0.01)
    assert_allclose(curvature_error, 1.580e-3, rtol=0.01)


@pytest.mark.parametrize("quadrature", ["reduced", "full"])
def test_straight_elements_miss_the_curvature_of_the_curve(quadrature):
    for n in (2, 4, 8):
        length_error, curvature_error = mesh_errors(
            create_beam(ARC, n, "straight", quadrature=quadrature)
        )
        half = 0.5 * ARC.length / (n * ARC.radius)
        # Ratio of chord to arc.
        assert_allclose(length_error, 1.0 - np.sin(half) / half, rtol=1e-9)
        assert_allclose(curvature_error, ARC.length / ARC.radius, rtol=1e-9)


@pytest.mark.parametrize("quadrature", ["reduced", "full"])
@every_shape
def test_line_has_no_mesh_errors(shape, quadrature):
    errors = mesh_errors(
        create_beam(bd.Line((0.0, 1.0), (3.0, 2.0)), 3, shape, quadrature=quadrature)
    )
    assert_allclose(errors, 0.0, atol=1e-13)  # rounding errors


@every_count
@every_frame
@every_curve
def test_nodes_of_curved_elements_lie_on_the_curve(curve, frame, nodes):
    frame = create_beam(curve, 3, "curved", frame, nodes=nodes).kinematics
    nodes_in_drawing = (
        frame.mesh_in_frame.node_points @ rotation(frame.frame_angle).T + frame.origin
    )
    step = nodes - 1
    on_curve = curve.point(np.linspace(0.0, curve.length, 3 * step + 1))
    for e in range(3):
        expected = on_curve[step * e : step * e + nodes]
        assert_allclose(nodes_in_drawing[e], expected, atol=1e-14 * 10)  # rounding errors


@every_count
@every_frame
@every_curve
def test_nodes_of_straight_elements_divide_the_chords_of_the_curve(curve, frame, nodes):
    frame = create_beam(curve, 3, "straight", frame, nodes=nodes).kinematics
    nodes_in_drawing = (
        frame.mesh_in_frame.node_points @ rotation(frame.frame_angle).T + frame.origin
    )
    ends = curve.point(np.linspace(0.0, curve.length, 4))
    for e in range(3):
        for i in range(nodes):
            expected = ends[e] + i / (nodes - 1) * (ends[e + 1] - ends[e])
            assert_allclose(nodes_in_drawing[e, i], expected, atol=1e-14 * 10)  # rounding errors


@every_curve
def test_axis_agrees_with_the_curve_where_it_interpolates_it(curve):
    frame = create_beam(curve, 40).kinematics
    element, xi = np.arange(40), np.linspace(-1.0, 1.0, 40)
    at, angle, _, ds = frame.mesh_in_frame.axis(element, xi)
    s = (element + 0.5 * (xi + 1.0)) * curve.length / 40
    on_curve = (curve.point(s) - frame.origin) @ rotation(frame.frame_angle)
    # Errors of cubic interpolation: fourth order in position, third order in direction.
    assert_allclose(at, on_curve, atol=1e-5)
    assert_allclose(angle, curve.tangent_angle(s) - frame.frame_angle, atol=1e-4)
    assert_allclose(ds, 0.5 * curve.length / 40, rtol=1e-4)


@pytest.mark.parametrize("nodes", [3, 4])
def test_kinks_between_curved_elements_are_of_third_order(nodes):
    kinks = []
    for n in (4, 8, 16):
        mesh = create_beam(ARC, n, nodes=nodes).mesh
        element = np.arange(n)
        end_angles, start_angles = (mesh.axis(element, np.full(n, xi)).angle for xi in (1.0, -1.0))
        kinks.append(np.abs(end_angles[:-1] - start_angles[1:]).max())
    # Measured 5.6e-4, 7.0e-5, 8.8e-6 rad with 4 nodes, 1.9e-3, 2.4e-4, 3.0e-5 rad with 3 nodes: the
    # slopes of quadratics have the same error of order h^2 on both sides of a node.
    assert_allclose(np.log2(np.divide(kinks[:-1], kinks[1:])), 3.0, atol=0.05)


@every_count
@every_frame
@every_shape
@every_curve
def test_operator_has_one_column_per_coordinate(curve, shape, frame, nodes):
    body = create_beam(curve, 3, shape, frame, nodes=nodes)
    operator, size = body.kinematics.operator, body.kinematics.element.size
    assert operator.shape == (3 * size, len(body.coordinates))
    assert len(set(body.coordinates)) == len(body.coordinates)
    assert len(body.initial_position) == len(body.coordinates)
    # Three nodal coordinates are fixed: the frame describes rigid motions.
    assert len(body.coordinates) == 3 + 3 * (3 * (nodes - 1) + 1) - 3
    frame_rows = operator.toarray().reshape(3, size, -1)[:, :FRAME_SIZE]
    assert_allclose(frame_rows, np.broadcast_to(np.eye(3, frame_rows.shape[2]), frame_rows.shape))


def displacements_in_elements(body, q):
    """Return (u, v, phi) of the nodes in the axes of each element, and the axis angles."""
    mesh, frame = body.kinematics.mesh_in_frame, body.kinematics
    local = (frame.operator @ q).reshape(mesh.elements, frame.element.size)[:, FRAME_SIZE:]
    nodal = local.reshape(mesh.elements, mesh.nodes, NODE_SIZE)
    xi = np.linspace(-1.0, 1.0, mesh.nodes)
    angles = np.stack(
        [mesh.axis(np.arange(mesh.elements), np.full(mesh.elements, x)).angle for x in xi]
    )
    return nodal, angles.T


@every_frame
@every_continuity
@every_curve
def test_displacement_and_rotation_are_continuous_at_the_nodes(
    curve, shape, continuity, nodes, frame
):
    body = create_beam(curve, 4, shape, frame, continuity=continuity, nodes=nodes)
    rng = np.random.default_rng(0)
    q = body.initial_position + rng.standard_normal(len(body.initial_position))
    nodal, angles = displacements_in_elements(body, q)
    for e in range(3):
        before = rotation(angles[e, -1]) @ nodal[e, -1, :2]
        after = rotation(angles[e + 1, 0]) @ nodal[e + 1, 0, :2]
        assert nodal[e, -1, 2] == nodal[e + 1, 0, 2]
        if continuity == "cartesian":
            assert_allclose(before, after, atol=1e-14 * np.linalg.norm(before))  # rounding errors
        else:
            # The elements share (u, v), but their axes differ by a kink of third order, at most
            # 0.01 rad for these curves.
            assert_allclose(nodal[e, -1], nodal[e + 1, 0], rtol=0.0)
            assert 0.0 < abs(angles[e, -1] - angles[e + 1, 0]) < 0.01


@every_count
@every_shape
def test_nodal_coordinates_are_components_along_the_curve(shape, nodes):
    """Components (u, v) in tangent frames of the curve give the same vectors in an element."""
    body = create_beam(ARC, 3, shape, nodes=nodes)
    mesh = body.mesh
    rng = np.random.default_rng(3)
    q = body.initial_position + rng.standard_normal(len(body.initial_position))
    nodal, angles = displacements_in_elements(body, q)
    tangent = ARC.tangent_angle(mesh.node_arc_lengths) - body.kinematics.frame_angle
    coordinates = [coordinate.name for coordinate in body.coordinates]
    for e in range(3):
        for i in range(nodes):
            node = (nodes - 1) * e + i
            if node == 0:
                continue
            names = (f"u{node}", f"v{node}")
            local = q[[coordinates.index(name) for name in names]]
            vector = rotation(angles[e, i]) @ nodal[e, i, :2]
            assert_allclose(
                vector, rotation(tangent[node]) @ local, atol=1e-14 * 10
            )  # rounding errors


@every_shape
@every_curve
def test_tangent_frame_moves_with_the_start_section(curve, shape):
    body = create_beam(curve, 2, shape, "tangent")
    rng = np.random.default_rng(1)
    nodal, _ = displacements_in_elements(body, rng.standard_normal(len(body.initial_position)))
    assert_allclose(nodal[0, 0], 0.0, atol=0.0)
    assert_allclose(body.initial_position[2], curve.tangent_angle(0.0), rtol=1e-15)


@every_continuity
@every_curve
def test_chord_frame_keeps_both_ends_on_the_chord(curve, shape, continuity, nodes):
    body = create_beam(curve, 2, shape, "chord", continuity=continuity, nodes=nodes)
    frame_angle, mesh = body.kinematics.frame_angle, body.kinematics.mesh_in_frame
    rng = np.random.default_rng(2)
    q = rng.standard_normal(len(body.initial_position))
    nodal, angles = displacements_in_elements(body, q)
    tip = mesh.node_points[-1, -1] + rotation(angles[-1, -1]) @ nodal[-1, -1, :2]
    chord = np.linalg.norm(curve.point(curve.length) - curve.point(0.0))
    along = q[[coordinate.name for coordinate in body.coordinates].index("chord")]
    off = 0.0
    if continuity == "local":
        # The components in the tangent frame are used for the axis, which differs by a small angle.
        off = abs(angles[-1, -1] - (curve.tangent_angle(curve.length) - frame_angle))
        assert off < 0.03
    assert_allclose(nodal[0, 0, :2], 0.0, atol=0.0)
    assert_allclose(tip, (chord + along, 0.0), atol=20 * 1e-14 + off * abs(along))
    direction = curve.point(curve.length) - curve.point(0.0)
    assert_allclose(frame_angle, np.arctan2(direction[1], direction[0]), rtol=1e-14)


@every_shape
@every_curve
def test_locate(curve, shape):
    mesh = create_beam(curve, 5, shape).mesh
    assert mesh.locate(0.0) == (0, -1.0)
    assert mesh.locate(curve.length) == (4, 1.0)
    element, xi = mesh.locate(0.5 * curve.length)
    assert element == 2
    assert_allclose(xi, 0.0, atol=1e-12)  # rounding errors


def test_chord_frame_of_a_ring_is_rejected():
    ring = bd.Arc(radius=0.5, length=np.pi)
    with pytest.raises(
        bd.BeamdaeError, match=r"hoop: frame 'chord' requires a curve with separate"
    ):
        bd.Beam("hoop", ring, SECTION, frame="chord")
    # A tangent frame does not require a chord.
    assert create_beam(ring, 8, frame="tangent").kinematics.frame_angle == 0.0


@pytest.mark.parametrize(
    ("turn", "frame"), [(0.5 * np.pi, "chord"), (1.7 * np.pi, "chord"), (2.0 * np.pi, "tangent")]
)
def test_default_frame_is_the_chord_unless_the_ends_nearly_meet(turn, frame):
    beam = bd.Beam("hoop", bd.Arc(radius=1.0, length=turn), SECTION)
    assert beam.kinematics.frame == frame
    assert beam.kinematics.strain == "green"


def build_strip(density=7850.0, start=(0.0, 0.0), **settings):
    steel = bd.Material(E=2.1e11, nu=0.3, rho=density)
    section = bd.Section.rectangle(steel, width=0.02, height=0.004)
    arc = bd.Arc(radius=0.8, length=0.6, start=start)
    return bd.Beam("strip", arc, section, elements=3, **settings)


def test_beams_that_differ_in_their_sections_share_their_geometry():
    one, other = build_strip(), build_strip(density=2700.0)
    assert one.mesh is other.mesh
    assert one.kinematics.operator is other.kinematics.operator
    assert one.end.operator is other.end.operator
    assert not np.array_equal(*(x.kinematics.data(np.zeros(2)) for x in (one, other)))


@pytest.mark.parametrize(
    "change",
    [{"start": (0.1, 0.0)}, {"frame": "tangent"}, {"formulation": "exact"}, {"nodes": 3}],
    ids=str,
)
def test_other_curves_frames_and_elements_have_other_geometries(change):
    one, other = build_strip(), build_strip(**change)
    assert one.kinematics.operator is not other.kinematics.operator
    assert one.end.operator is not other.end.operator


def test_curves_given_by_functions_have_geometries_of_their_own():
    """The function may depend on variables, which are not compared."""
    variables = {"rise": 0.1}
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)

    def height(x):
        return variables["rise"] * x**2

    ends = []
    for rise in (0.1, 0.3):
        variables["rise"] = rise
        beam = bd.Beam("strip", bd.Curve(height, x=(0.0, 1.0)), section, elements=3)
        ends.append(beam.end.point[1])
    assert ends == pytest.approx([0.1, 0.3], rel=1e-9)
