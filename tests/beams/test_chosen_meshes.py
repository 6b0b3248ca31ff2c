"""Meshes of beams: nodes on the curve, chosen meshes, and copies with other meshes."""

import math
import threading
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from mechanisms import clamped_beam, rectangle
from numpy.testing import assert_allclose
from support import ARC, VARIANTS, NumericEquations, random_state

import beamdae as bd
from beamdae.beams.remeshing import replace_beams

ALLOY = bd.Material(E=7e10, nu=0.33, rho=2700.0)
THICK, THIN = (bd.Section.rectangle(ALLOY, width=0.02, height=x) for x in (0.008, 0.004))
TAPER = bd.taper(bd.Section.rectangle, ALLOY, width=0.02, height=(0.006, 0.002, 0.004))
LINE = bd.Line((0.0, 0.0), (1.0, 0.0))
SHORT_ARC = bd.Arc(radius=0.5, length=0.9)
CLOTHOID = bd.IntrinsicCurve(lambda s: 2.0 * s, 1.0)
EXACT = {"formulation": "exact"}
FLOATING = {"formulation": "floating frame", "strain": "exact"}
every_formulation = pytest.mark.parametrize("settings", [EXACT, FLOATING])


class Bent:
    """Straight pieces that meet at an angle."""

    length, angle = 1.0, 0.7
    breaks = (0.4,)

    def point(self, s):
        first, second = np.minimum(s, 0.4), np.maximum(np.asarray(s) - 0.4, 0.0)
        x = first + np.cos(self.angle) * second
        return np.stack([x, np.sin(self.angle) * second], axis=-1)

    def tangent_angle(self, s):
        return np.where(np.asarray(s) < 0.4, 0.0, self.angle)

    def curvature(self, s):
        return np.zeros(np.shape(s))


def clamp(curve, section, gravity=(0.0, -9.81), masses=(), **settings):
    mech = bd.Mechanism(gravity=gravity)
    beam = mech.add(bd.Beam("arm", curve, section, **settings))
    point = tuple(curve.point(0.0).tolist())
    mech.add(bd.Weld("clamp", mech.ground.at(*point), beam.start))
    for s in masses:
        mech.add(bd.PointMass(f"mass at {s}", 0.1, on=beam.at(s)))
    mech.observe("tip", beam.end)
    mech.observe("root", beam.section_forces(0.1))
    return mech, beam


def solve(mech):
    return np.array([x[-1] for x in bd.equilibrium(mech).columns.values()])


def shape_of(beam):
    return beam.mesh.elements, beam.mesh.nodes - 1


@every_formulation
@pytest.mark.parametrize(
    ("curve", "section", "masses"),
    [
        (SHORT_ARC, THIN, ()),
        (LINE, TAPER, (0.3,)),
        (CLOTHOID, THIN, (0.11, 0.9)),
        (SHORT_ARC, TAPER, (0.45,)),
    ],
)
def test_equals_the_same_mesh_given_explicitly(curve, section, masses, settings):
    mech, beam = clamp(curve, section, masses=masses, **settings)
    result = solve(mech)
    mesh = beam.mesh
    assert all(map(mesh.has_end_at, masses))
    given = {"elements": mesh.element_bounds.tolist(), "nodes": mesh.nodes}
    other, _ = clamp(curve, section, masses=masses, **given, **settings)
    assert_allclose(solve(other), result, rtol=1e-12)


@every_formulation
@pytest.mark.parametrize("turn", [0.5, 2.0])
def test_a_moment_bends_a_beam_to_an_arc(turn, settings):
    mech, beam = clamp(LINE, THIN, gravity=(0.0, 0.0), **settings)
    mech.add(bd.Moment("moment", beam.end, turn * THIN.EI))
    x, y, angle, *_ = solve(mech)
    expected = math.sin(turn) / turn, (1.0 - math.cos(turn)) / turn, turn
    # The largest change of the angle within the element is 2 rad: a^8 / 15!! is about 1e-6 there.
    assert_allclose((x, y, angle), expected, atol=2e-6)


@every_formulation
@pytest.mark.parametrize("curve", [LINE, SHORT_ARC, CLOTHOID])
def test_errors_decrease_exponentially_with_the_degree(curve, settings):
    reference, *results = (
        solve(clamp(curve, THIN, elements=1, nodes=n, **settings)[0]) for n in (13, 4, 6, 8, 10)
    )
    errors = [np.max(np.abs(x / reference - 1.0)) for x in results]
    assert all(b < 0.25 * a for a, b in pairwise(errors))
    assert errors[-1] < 1e-4 * errors[0]


@every_formulation
def test_elements_end_at_kinks_of_the_curve(settings):
    curve = Bent()
    mech, beam = clamp(curve, THIN, **settings)
    result = solve(mech)
    assert beam.mesh.has_end_at(0.4)
    mech, first = clamped_beam(THIN, None, 0.4, name="first", gravity=9.81, **EXACT)
    end = tuple(curve.point(1.0).tolist())
    second = mech.add(bd.Beam("second", bd.Line((0.4, 0.0), end), THIN, **EXACT))
    mech.add(bd.Weld("bend", first.end, second.start))
    mech.observe("tip", second.end)
    mech.observe("root", first.section_forces(0.1))
    expected = solve(mech)
    # N is interpolated together with Q, which is thirty times as large.
    assert_allclose(result, expected, rtol=1e-7, atol=1e-8)
    assert bd.Segment(curve, 0.3, 0.8).breaks == pytest.approx((0.1,))


@pytest.mark.parametrize("at", [0.31, 0.5, 0.77])
@every_formulation
def test_elements_end_at_jumps_of_the_section(at, settings):
    mech, beam = clamp(LINE, lambda s: THICK if s < at else THIN, **settings)
    result = solve(mech)
    assert beam.mesh.has_end_at(at)
    given = {"elements": [0.0, at, 1.0], "nodes": beam.mesh.nodes}
    other, _ = clamp(LINE, lambda s: THICK if s < at else THIN, **given, **settings)
    assert_allclose(result, solve(other), rtol=1e-7)


def test_meshes_by_attachments():
    expected = {0: (1, 7), 1: (2, 6), 2: (3, 5), 7: (8, 3), 40: (8, 3)}
    for count, shape in expected.items():
        masses = (np.arange(1, count + 1) / (count + 1)).tolist()
        mech, beam = clamp(LINE, THIN, masses=masses)
        bd.equilibrium(mech)
        assert shape_of(beam) == shape


def test_cubic_elements_where_the_setting_or_load_excludes_long_ones():
    for settings in (
        {"nodes": 5},
        {"elements_shape": "straight"},
        {"continuity": "local"},
    ):
        beam = bd.Beam("arm", SHORT_ARC, THIN, **settings)
        assert shape_of(beam) == (8, settings.get("nodes", 4) - 1)
        assert not beam._has_chosen_mesh
    mech, beam = clamp(LINE, THIN)
    mech.add(bd.MovingForce("load", beam, (0.0, -1.0), speed=1.0))
    bd.equilibrium(mech)
    assert shape_of(beam) == (8, 3)


@pytest.mark.parametrize(
    "curve",
    [
        bd.Arc(radius=1.0 / (2.0 * np.pi), length=1.0),
        bd.Curve(lambda x: 0.1 * np.sin(4.0 * np.pi * x), x=(0.0, 1.0)),
        bd.Parabola(span=1.0, rise=0.5),
    ],
)
def test_elements_follow_the_curve(curve):
    s = np.linspace(0.0, curve.length, 101)
    beam = bd.Beam("arm", curve, THIN, **EXACT)
    points = [beam.at(x).point for x in s.tolist()]
    # Eight cubic elements on the sine are off by 1e-3.
    assert_allclose(points, curve.point(s), atol=1e-3)


@every_formulation
def test_ten_modes_are_accurate(settings):
    mech, _ = clamp(LINE, THIN, **settings)
    fine, _ = clamp(LINE, THIN, elements=32, **settings)
    frequencies, expected = (bd.modes(x).frequencies for x in (mech, fine))
    # Eight cubic elements are off by 1.6 %.
    assert_allclose(frequencies, expected, rtol=5e-4)
    model = bd.linearize(mech, inputs=[], outputs=[])
    assert len(model.states) == 2 * len(bd.modes(mech, n=None))


@every_formulation
def test_companions_have_higher_degrees(settings):
    mech, beam = clamp(SHORT_ARC, THIN, masses=(0.45,), **settings)
    errors = bd.equilibrium(mech).errors
    assert errors.refined.degrees == {"arm": 6}
    assert str(errors.refined).startswith("a repetition with higher degrees of arm")
    assert errors.largest < 0.01
    assert "accuracy=1e-12" in errors.recommend(1e-12)
    assert shape_of(beam) == (2, 6)


# Nodes on the curve, and errors of the interpolated axes.

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


# Copies of mechanisms with other meshes: formulas contain the signals of the copy.

LIGHT_ALLOY = bd.Material(E=6.9e10, nu=0.3, rho=2700.0)
METHOD = bd.GeneralizedAlpha(1e-3)


def sensor_in_law(mech, tip):
    v = mech.sensor("v", tip, "y_dot")
    mech.add(bd.Force("brake", tip, (0.0, -3.0 * v)))


def global_sensor_in_formula(mech, tip):
    global speed
    speed = mech.sensor("v", tip, "y_dot")
    mech.add(bd.ForceLaw("brake", tip, lambda point, t: (0.0, -3.0 * speed - point.velocity[1])))


def work_of_a_damper(mech, tip):
    damper = mech.add(bd.Spring("damper", mech.ground.at(0.3, -1.0), tip, damping=2.0))
    mech.state("work", mech.sensor("power", damper.power), unit="J")


def servo(mech, tip):
    y, v = mech.sensor("y", tip, "y"), mech.sensor("v", tip, "y_dot")
    force = bd.pid(mech, "servo", 0.01 - y, kp=30.0, ki=400.0, kd=4.0, rate=-v, limits=(-5.0, 5.0))
    mech.add(bd.Force("motor", tip, (0.0, force)))


def sampled(mech, tip):
    y = mech.sensor("y", tip, "y")
    u = mech.input("u", unit="N")
    mech.add(bd.Force("motor", tip, (0.0, u)))
    mech.add(bd.Controller("law", 5e-3, [y], [u], lambda sample: -50.0 * sample.reads[0]))


def states(mech, tip):
    position = mech.state("position", start=1.0)
    velocity = mech.state("velocity", lambda velocity, t: -400.0 * position - velocity)
    position.follows(velocity)
    mech.add(bd.Force("pull", tip, (0.0, 2.0 * position)))


def build(add):
    strip = rectangle(0.003, damping=1e-4, material=LIGHT_ALLOY)
    mech, beam = clamped_beam(strip, 2, 0.3, name="rod", gravity=9.81)
    add(mech, beam.end)
    mech.observe("tip", beam.end)
    return mech, beam


SIGNALS = [sensor_in_law, global_sensor_in_formula, work_of_a_damper, servo, sampled, states]


@pytest.mark.parametrize("add", SIGNALS)
def test_regression_copies_contain_their_own_signals(add):
    """Mesh comparisons and `check` of most mechanisms with states failed.

    Formulas of the copy contained the sensors and states of the original mechanism.
    """
    mech, beam = build(add)
    before = bd.simulate(mech, METHOD, t_end=0.02)
    copy = replace_beams(mech, {"rod": beam._with_mesh(beam.mesh)}, "test")
    assert all(copy.parts[name] is not part for name, part in mech.parts.items())
    run = bd.simulate(copy, METHOD, t_end=0.02)
    assert list(run.columns) == list(before.columns)
    for name, values in before.columns.items():
        assert_allclose(run.columns[name], values, rtol=1e-7, atol=1e-9, err_msg=name)
    # The original mechanism still has its own signals.
    again = bd.simulate(mech, METHOD, t_end=0.02)
    assert_allclose(again["tip.y"], before["tip.y"], rtol=1e-9)
    finer = replace(beam.mesh, elements=4)
    run = bd.simulate(
        replace_beams(mech, {"rod": beam._with_mesh(finer)}, "test"), METHOD, t_end=0.02
    )
    assert_allclose(run["tip.y"], before["tip.y"], atol=1e-3 * np.ptp(before["tip.y"]))


LOCK = threading.Lock()


def test_regression_laws_with_locks_and_variables_without_a_value():
    """The message asked for functions where a function contained the lock."""
    lock = threading.Lock()

    def law_with_lock(sample):
        with lock:
            return -sample.reads[0]

    def law_with_global_lock(sample):
        with LOCK:
            return -sample.reads[0]

    def law_without_value(sample):
        return -gain * sample.reads[0]

    def copy_with(law):
        def add(mech, tip):
            u = mech.input("u", unit="N")
            mech.add(bd.Controller("law", 5e-3, [mech.sensor("y", tip, "y")], [u], law))

        mech, beam = build(add)
        return replace_beams(mech, {"rod": beam._with_mesh(beam.mesh)}, "test")

    with pytest.raises(bd.BeamdaeError, match=r"cannot pickle .*lock.*in global variables\.$"):
        copy_with(law_with_lock)
    copy_with(law_with_global_lock)
    copied = copy_with(law_without_value).part("law").law
    gain = 2.0
    assert copied is not law_without_value
    assert law_without_value(SimpleNamespace(reads=[1.0])) == -gain


@pytest.mark.slow(reason="a fifth of a second")
def test_mechanisms_with_compiled_gravity_laws_are_copied():
    """Machine code cannot be copied, and kernels are found by their ids."""
    mech = bd.Mechanism(gravity=(0.0, lambda t: -9.81 + 0.0 * t))
    section = rectangle(0.01)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), section))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    first = bd.equilibrium(mech)
    again = bd.equilibrium(replace_beams(mech, {}, "test"))
    assert_allclose(again["tip.y"].iloc[-1], first["tip.y"].iloc[-1], rtol=1e-12)


def test_regression_laws_without_a_module_are_copied():
    """Functions of `eval` with own global names have no module."""
    mech = bd.Mechanism()
    section = rectangle(0.01)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements=1))
    gauge = mech.sensor("gauge", beam.end, "y")
    mech.add(bd.Force("push", beam.end, (0.0, gauge)))
    law = eval("lambda point, t: (0.0, 2.0 * t)", {"__builtins__": {}})
    assert law.__module__ is None
    mech.add(bd.ForceLaw("law", beam.end, law))
    copied = replace_beams(mech, {"beam": beam._with_mesh(beam.mesh)}, "test")
    assert bd.equations_of_motion(copied).n == bd.equations_of_motion(mech).n


@pytest.mark.parametrize(
    ("options", "degree"),
    [
        ({"formulation": "exact"}, None),
        ({"formulation": "exact"}, 5),
        ({"formulation": "exact", "nodes": 3}, None),
        ({"frame": "chord"}, None),
        ({"frame": "chord"}, 5),
        ({"frame": "tangent"}, None),
        ({"elements_shape": "straight", "elements": 40}, None),
    ],
)
def test_motions_on_both_meshes_are_equal(options, degree):
    elements = options.pop("elements", 6)
    curve, section = bd.Arc(0.5, 1.0, angle=1.0), rectangle(2e-3, material=LIGHT_ALLOY)
    coarse = bd.Beam("arch", curve, section, elements, **options)
    mesh = coarse.mesh.with_degree(degree) if degree else coarse.mesh.with_divided_elements(2)
    fine = coarse._with_mesh(mesh)
    matrix = coarse._prolongation_to(fine)
    # The neglected angles between axes are up to 0.05 for straight elements, times the amplitude.
    amplitude = 1e-3
    rng = np.random.default_rng(1)
    change = amplitude * rng.standard_normal(len(coarse.coordinates))
    q = coarse.initial_position + change
    other = fine.initial_position + matrix @ change
    for s in np.linspace(0.0, 1.0, 4):
        positions = []
        for beam, coordinates in ((coarse, q), (fine, other)):
            point = beam.kinematics.material_point(float(s))
            values = point.motion(point.operator @ coordinates)
            positions.append(np.array(values[0]).ravel())
        assert positions[0] == pytest.approx(positions[1], abs=1e-4)
