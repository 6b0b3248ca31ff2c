"""Nodes on the curve, and errors of the interpolated axes."""

import numpy as np
import pytest
from mechanisms import rectangle
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations, random_state

import beamdae as bd

SECTION = VARIANTS[0].section
CURVES = {
    "arc": ARC,
    "right arc": bd.Arc(radius=-0.9, length=2.5, start=(1.0, 2.0), angle=2.0),
    "shallow parabola": bd.Parabola(span=4.0, rise=0.2, start=(1.0, 0.0), angle=0.5),
    "parabola": bd.Parabola(span=4.0, rise=1.0),
}
every_curve = pytest.mark.parametrize("curve", CURVES.values(), ids=list(CURVES))
every_shape = pytest.mark.parametrize("shape", ["curved", "straight"])


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


def mesh_errors(body):
    """Return the largest relative error of arc length and error of curvature times length."""
    mesh, points = body.mesh, 8  # enough to resolve the error of the arc length
    lengths = mesh.gauss(points)[0].reshape(mesh.elements, points).sum(axis=1)
    length_error = np.max(np.abs(lengths - mesh.element_lengths) / mesh.element_lengths)
    return length_error, mesh.curvature_error(body.kinematics.stiffness_points)


@pytest.mark.parametrize("quadrature", ["reduced", "full"])
@pytest.mark.parametrize("nodes", [3, 4])
@every_curve
def test_orders_of_mesh_errors_of_curved_elements(curve, nodes, quadrature):
    """Arc length converges with fourth order, curvature with the order of its interpolation.

    The error of quadratic interpolation is h^3 xi (xi^2 - 1) / 48 times the third derivative. This
    function is odd in xi, so the length of an element has an error of the next order. The second
    derivative of the error across the axis is h xi / 2 times the derivative of the curvature, which
    is zero on an arc.
    """
    beams = (create_beam(curve, n, quadrature=quadrature, nodes=nodes) for n in (16, 32, 64))
    errors = [mesh_errors(beam) for beam in beams]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    # Rounding errors of lengths are 1e-14; the smallest error is at least 5e-13.
    assert_allclose(orders[:, 0], 4.0, atol=0.1)
    assert_allclose(orders[:, 1], 2.0 if nodes == 4 or isinstance(curve, bd.Arc) else 1.0, atol=0.1)


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


@pytest.mark.parametrize(
    ("turn", "frame"), [(0.5 * np.pi, "chord"), (1.7 * np.pi, "chord"), (2.0 * np.pi, "tangent")]
)
def test_default_frame_is_the_chord_unless_the_ends_nearly_meet(turn, frame):
    beam = bd.Beam("hoop", bd.Arc(radius=1.0, length=turn), SECTION)
    assert beam.kinematics.frame == frame
    assert beam.kinematics.strain == "exact"


def test_curves_given_by_functions_have_geometries_of_their_own():
    """The function may depend on variables, which are not compared."""
    variables = {"rise": 0.1}
    section = rectangle(0.004)

    def height(x):
        return variables["rise"] * x**2

    ends = []
    for rise in (0.1, 0.3):
        variables["rise"] = rise
        beam = bd.Beam("strip", bd.Curve(height, x=(0.0, 1.0)), section, elements=3)
        ends.append(beam.end.point[1])
    assert ends == pytest.approx([0.1, 0.3], rel=1e-9)


@pytest.mark.parametrize("nodes", [2, 3, 4, 7])
@pytest.mark.parametrize("frame", ["tangent", "chord"])
@every_curve
def test_nodes_lie_on_the_curve_and_sections_near_it(curve, frame, nodes):
    mech, elements = bd.Mechanism(), 40
    beam = mech.add(create_beam(curve, elements, frame=frame, nodes=nodes))
    # Errors of interpolation between nodes are of the order `nodes`.
    off = {2: 1e-3, 3: 1e-4, 4: 1e-5, 7: 1e-9}[nodes]
    places = {elements * (nodes - 1): 1e-13, 777: off}
    for count in places:
        for k in (1, count // 2, count):
            mech.observe(f"{count} {k}", beam.at(k / count * curve.length))
    numeric = NumericEquations(mech)
    for count, error in places.items():
        for k in (1, count // 2, count):
            at = numeric.observed(f"{count} {k}")[:3]
            s = k / count * curve.length
            assert_allclose(at[:2], curve.point(s), atol=error)
            assert_allclose(at[2], curve.tangent_angle(s), atol=1e-13)


@pytest.mark.parametrize("frame", ["tangent", "chord"])
@every_curve
def test_elements_of_two_nodes_are_straight(curve, frame):
    curved, straight = (
        NumericEquations(mechanism_of(create_beam(curve, 5, shape, frame, nodes=2)))
        for shape in ("curved", "straight")
    )
    q, v, a = random_state(curved, seed=0)
    # Rounding errors only.
    assert_allclose(curved.force(q, v, a), straight.force(q, v, a), rtol=1e-11, atol=1e-11)
    for name in ("mass", "stiffness"):
        of_curved, of_straight = (getattr(x, name)(q, v, a) for x in (curved, straight))
        assert_allclose(of_curved, of_straight, rtol=1e-10, atol=1e-10)


def mechanism_of(beam):
    mech = bd.Mechanism()
    mech.add(beam)
    return mech
