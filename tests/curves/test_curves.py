"""Points, angles and curvatures agree with each other and with closed forms."""

import warnings
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import beamdae as bd

CIRCLE = np.stack(
    [1.5 * np.sin(np.linspace(0.0, 2.0, 40)), 1.5 * (1.0 - np.cos(np.linspace(0.0, 2.0, 40)))], -1
)
CURVES = {
    "line": bd.Line((0.5, -1.0), (-1.5, 0.3)),
    "left arc": bd.Arc(radius=0.85, length=0.8, start=(0.1, 0.2), angle=-0.6),
    "right arc": bd.Arc(radius=-2.0, length=9.0, angle=2.5),
    "full circle": bd.Arc(radius=0.5, length=np.pi),
    "parabola": bd.Parabola(span=4.0, rise=1.0, start=(1.0, 0.0), angle=0.3),
    "hanging parabola": bd.Parabola(span=0.7, rise=-0.9, angle=-2.0),
    "flat parabola": bd.Parabola(span=2.0, rise=0.0),
    "function": bd.Curve(lambda x: 0.3 * np.sin(2.0 * x), x=(-0.4, 2.0)),
    "function backwards": bd.Curve(lambda x: np.exp(0.5 * x), x=(1.0, -1.0)),
    "points": bd.Curve(points=CIRCLE),
    "clothoid": bd.IntrinsicCurve(lambda s: 3.0 * s - 1.0, 1.4, start=(0.2, 0.1), angle=0.5),
    "part of an arc": bd.Segment(bd.Arc(radius=-2.0, length=9.0, angle=2.5), 1.5, 6.0),
    "part of a parabola": bd.Segment(bd.Parabola(span=4.0, rise=1.0), 0.0, 1.2),
}
every_curve = pytest.mark.parametrize("curve", CURVES.values(), ids=list(CURVES))
lengths = st.floats(0.01, 100.0)
angles = st.floats(-7.0, 7.0)
places = st.tuples(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))


def assert_consistent(curve):
    length = curve.length
    h = 1e-4 * length
    s = np.linspace(3 * h, length - 3 * h, 23)
    angle, curvature = curve.tangent_angle(s), curve.curvature(s)
    tangent = (curve.point(s + h) - curve.point(s - h)) / (2.0 * h)
    # Truncation error (h / R)^2 / 6 of differences, and rounding errors of the coordinates.
    rounding = 1e-15 * (np.abs(curve.point(s)).max() + length) / h
    tolerance = (h * np.abs(curvature).max()) ** 2 + rounding + 1e-11
    assert_allclose(tangent, np.stack([np.cos(angle), np.sin(angle)], axis=-1), atol=tolerance)
    turning = (curve.tangent_angle(s + h) - curve.tangent_angle(s - h)) / (2.0 * h)
    # In the sharpest case, the curvature changes by 100 % over a hundredth of the length.
    size = np.abs(curvature).max()
    assert_allclose(turning * length, curvature * length, atol=1e-3 * size * length + 1e-8)


def test_ends_are_points_of_the_drawing():
    ends = {
        "left arc": (
            0.1 + 0.85 * (np.sin(-0.6 + 0.8 / 0.85) - np.sin(-0.6)),
            0.2 - 0.85 * (np.cos(-0.6 + 0.8 / 0.85) - np.cos(-0.6)),
        ),
        "flat parabola": (2.0, 0.0),
        "points": tuple(CIRCLE[-1]),
        "function": (2.0, 0.3 * np.sin(4.0)),
    }
    for name, end in ends.items():
        assert isinstance(CURVES[name].end, tuple)
        assert_allclose(CURVES[name].end, end, atol=1e-12)
    clothoid = CURVES["clothoid"]
    assert_allclose(clothoid.end, clothoid.point(1.4), atol=0.0)
    bd.Line(clothoid.end, (3.0, 0.0))


@every_curve
def test_tangent_and_curvature_are_rates_by_arc_length(curve):
    assert_consistent(curve)


@every_curve
def test_arc_length_is_that_of_a_fine_polygon(curve):
    s = np.linspace(0.0, curve.length, 4001)
    chords = np.linalg.norm(np.diff(curve.point(s), axis=0), axis=1)
    ds = curve.length / 4000
    shorter = (ds * curve.curvature(s[:-1] + 0.5 * ds)) ** 2 / 24.0
    # The next term of the chord length, and the change of curvature along the chord.
    assert_allclose(chords, ds * (1.0 - shorter), rtol=2e-9)


@every_curve
def test_methods_accept_arc_lengths_of_any_shape(curve):
    s = np.linspace(0.0, curve.length, 6).reshape(2, 3)
    assert curve.point(s).shape == (2, 3, 2)
    assert curve.point(0.0).shape == (2,)
    for method in (curve.tangent_angle, curve.curvature):
        assert method(s).shape == (2, 3)
        assert np.shape(method(0.0)) == ()
        assert_allclose(method(s)[1, 2], method(curve.length), rtol=1e-15)


@given(
    radius=st.one_of(lengths, lengths.map(lambda x: -x)),
    share=st.floats(0.001, 1.0),
    start=places,
    angle=angles,
)
def test_random_arcs(radius, share, start, angle):
    arc = bd.Arc(radius, share * 2.0 * np.pi * abs(radius), start, angle)
    assert_consistent(arc)
    size = abs(radius) + np.hypot(*start)
    # Rounding errors, relative to the size of the coordinates.
    assert_allclose(arc.point(0.0), start, atol=1e-14 * size)
    normal = np.array([-np.sin(angle), np.cos(angle)])
    s = np.linspace(0.0, arc.length, 7)
    to_center = arc.point(s) - (np.asarray(start) + radius * normal)
    assert_allclose(np.linalg.norm(to_center, axis=1), abs(radius), atol=1e-13 * size)


def test_almost_straight_arc_is_accurate():
    arc = bd.Arc(radius=1e9, length=2.0)
    # Rounding errors of the coordinates, not of the radius.
    assert_allclose(arc.point(2.0), (2.0, 2e-9), rtol=1e-14)


@given(span=lengths, slope=st.floats(-3.0, 3.0), start=places, angle=angles)
def test_random_parabolas(span, slope, start, angle):
    """Parabolas y = 4 d x (l - x) / l^2 agree with closed forms."""
    rise = slope * span / 4.0
    parabola = bd.Parabola(span, rise, start, angle)
    assert_consistent(parabola)
    k = abs(slope)
    expected = span * (0.5 * np.hypot(1.0, k) + (np.arcsinh(k) / (2.0 * k) if k > 1e-8 else 0.5))
    # Rounding errors of the sum over 400 intervals of eight Gauss points.
    assert_allclose(parabola.length, expected, rtol=1e-12)
    across = np.array([np.cos(angle), np.sin(angle)])
    ends = np.array([start, start + span * across])
    size = span + np.hypot(*start)
    assert_allclose(parabola.point([0.0, parabola.length]), ends, atol=1e-12 * size)
    apex = start + 0.5 * span * across + rise * np.array([-across[1], across[0]])
    middle = 0.5 * parabola.length
    assert_allclose(parabola.point(middle), apex, atol=1e-12 * size)
    half_turn = np.arctan(slope)
    tangents = [angle + half_turn, angle, angle - half_turn]
    tangent_angles = parabola.tangent_angle([0.0, middle, parabola.length])
    assert_allclose(np.exp(1j * tangent_angles), np.exp(1j * np.array(tangents)), atol=1e-11)
    assert_allclose(
        tangent_angles - tangent_angles[0], [0.0, -half_turn, -2.0 * half_turn], atol=1e-11
    )
    assert_allclose(parabola.curvature(middle) * span, -2.0 * slope, atol=1e-10)


def test_curve_of_the_circle_function_is_the_arc():
    radius, angle = 10.0, np.radians(30.0)
    arc = bd.Arc(radius, radius * angle)
    curve = bd.Curve(lambda x: radius - np.sqrt(radius**2 - x**2), x=(0.0, radius * np.sin(angle)))
    s = np.linspace(0.0, arc.length, 31)
    # The quintic spline through 601 values has rounding errors only; each derivative multiplies
    # them by the 600 intervals.
    assert_allclose(curve.length, arc.length, rtol=1e-13)
    assert_allclose(curve.point(s), arc.point(s), atol=1e-12)
    assert_allclose(curve.tangent_angle(s), arc.tangent_angle(s), atol=1e-11)
    assert_allclose(curve.curvature(s), arc.curvature(s), atol=1e-9)


def test_curve_through_points_converges_with_fourth_order():
    arc = bd.Arc(1.5, 3.0)
    off = []
    for n in (10, 20, 40):
        curve = bd.Curve(points=arc.point(np.linspace(0.0, arc.length, n + 1)))
        s = np.linspace(0.0, min(curve.length, arc.length), 200)
        off.append(np.abs(curve.point(s) - arc.point(s)).max())
    # Cubic splines are of fourth order; measured 3.9 and 4.0.
    assert np.all(np.log2(np.divide(off[:-1], off[1:])) > 3.7)
    assert off[-1] < 1e-6


def test_constant_curvature_gives_an_arc():
    arc = bd.Arc(-0.8, 3.0, start=(0.3, -0.2), angle=1.0)
    curve = bd.IntrinsicCurve(lambda s: -1.25, 3.0, start=(0.3, -0.2), angle=1.0)
    s = np.linspace(0.0, 3.0, 31)
    # Rounding errors only.
    assert_allclose(curve.point(s), arc.point(s), atol=1e-13)
    assert_allclose(curve.tangent_angle(s), arc.tangent_angle(s), atol=1e-13)


def test_clothoid_matches_fresnel_integrals():
    from scipy.special import fresnel

    # With the curvature pi s, the angle is pi s^2 / 2, the argument of Fresnel's integrals.
    curve = bd.IntrinsicCurve(lambda s: np.pi * s, 2.0)
    s = np.linspace(0.0, 2.0, 9)
    sine, cosine = fresnel(s)
    assert_allclose(curve.point(s), np.stack([cosine, sine], axis=-1), atol=1e-13)


def test_tangent_angle_is_continuous_over_a_full_turn():
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    ring = bd.Curve(points=np.stack([np.cos(turn), np.sin(turn)], axis=-1))
    angle = ring.tangent_angle(np.linspace(0.0, ring.length, 500))
    assert np.abs(np.diff(angle)).max() < 0.03
    # The end conditions of the spline cause errors of 1e-5 in the end tangents.
    assert_allclose(angle[-1] - angle[0], 2.0 * np.pi, atol=1e-3)
    assert bd.Arc(1.0, 2.0 * np.pi).tangent_angle(2.0 * np.pi) == 2.0 * np.pi


def test_a_backward_interval_reverses_the_curve():
    def rise(x):
        return 0.2 * x**2

    forward, backward = bd.Curve(rise, x=(0.0, 1.0)), bd.Curve(rise, x=(1.0, 0.0))
    s = np.linspace(0.0, forward.length, 11)
    # Rounding errors only.
    assert_allclose(backward.point(s), forward.point(forward.length - s), atol=1e-12)
    assert_allclose(backward.curvature(s), -forward.curvature(forward.length - s), atol=1e-8)


def assert_same_from(curve, part, s):
    """Assert that `part` equals the curve from arc length `s` on."""
    x = np.linspace(0.0, part.length, 9)
    size = curve.length + np.abs(curve.point(s)).max()
    assert_allclose(part.point(x), curve.point(s + x), atol=1e-14 * size)
    turning = curve.length * np.abs(curve.curvature(s + x)).max()
    for of_part, of_curve in (
        (part.tangent_angle(x), curve.tangent_angle(s + x)),
        (part.curvature(x) * curve.length, curve.curvature(s + x) * curve.length),
    ):
        assert_allclose(of_part, of_curve, atol=1e-12 * (1.0 + turning))


@pytest.mark.slow(reason="a fifth of a second")
@given(
    curve=st.sampled_from(list(CURVES.values())),
    percents=st.sets(st.integers(1, 99), max_size=4),
)
def test_segments_equal_their_part_of_the_curve(curve, percents):
    cuts = [0.0, *(curve.length * p / 100.0 for p in sorted(percents)), curve.length]
    parts = [bd.Segment(curve, start, end) for start, end in pairwise(cuts)]
    # Rounding errors of sums.
    assert_allclose(sum(part.length for part in parts), curve.length, rtol=1e-14)
    for part, start in zip(parts, cuts, strict=False):
        assert_same_from(curve, part, start)
        # A segment of a segment.
        rest = bd.Segment(part, 0.3 * part.length, part.length)
        assert_same_from(curve, rest, start + 0.3 * part.length)
    for one, other in pairwise(parts):
        assert_allclose(one.point(one.length), other.point(0.0), atol=1e-13 * curve.length)


nan = float("nan")

SENTENCES = {
    r"^Line: start and end must differ.*\(1.0, 2.0\)": lambda: bd.Line((1.0, 2.0), (1.0, 2.0)),
    "^Arc: radius must not be zero": lambda: bd.Arc(0.0, 1.0),
    "^Arc: a length of 6.3 m folds the curve onto itself.*6.28319 m": lambda: bd.Arc(-1.0, 6.3),
    "^Curve: either function or points must be given": lambda: bd.Curve(),
    r"^Curve: a function requires an interval; pass x=\(x_start, x_end\)": lambda: bd.Curve(np.sin),
    "^Curve: the interval x must not be empty": lambda: bd.Curve(np.sin, x=(1.0, 1.0)),
    "^Curve: the function is nan at x = 0 m; the value must be finite for every x": lambda: (
        bd.Curve(lambda x: 1.0 / x if x else np.nan, x=(0.0, 1.0))
    ),
    "^Curve: the function must return a number .* failed at .*: .*division": lambda: bd.Curve(
        lambda x: 1.0 / (x - 0.5), x=(0.0, 1.0)
    ),
    "^IntrinsicCurve: law must be a function of s, got 2": lambda: bd.IntrinsicCurve(2.0, 1.0),
    "the call failed at s = 0 m: ZeroDivisionError": lambda: bd.IntrinsicCurve(
        lambda s: 1 / s, 1.0
    ),
    "the curvature at s = 0 m must be finite": lambda: bd.IntrinsicCurve(lambda s: np.nan, 1.0),
    "turns the tangent by 39.1 rad within 1/25600": lambda: bd.IntrinsicCurve(lambda s: 1e6, 1.0),
    "^Curve: points must be at least 4 pairs": lambda: bd.Curve(points=CIRCLE[:3]),
    "^Curve: point 1 y must be finite": lambda: bd.Curve(
        points=[(0, 0), (1, np.nan), (2, 0), (3, 0)]
    ),
    r"^Curve: the point \(1, 2\) m is repeated": lambda: bd.Curve(
        points=[(0, 0), (1, 2), (1, 2), (3, 0)]
    ),
    r"^Curve: the curve folds onto itself at the point \(2, 0\) m": lambda: bd.Curve(
        points=[(0, 0), (1, 0), (2, 0), (1.5, 0), (3, 0)]
    ),
    "^Curve: the curve folds onto itself": lambda: bd.Curve(
        lambda x: abs(x) ** (1.0 / 3.0), x=(-1.0, 1.0)
    ),
    r"^Segment: start and end must ascend within \[0, 2.38\d+\] m, got 1 and 1 m": lambda: (
        bd.Segment(CURVES["line"], 1.0, 1.0)
    ),
    "^Segment: .*got 1 and 2.4 m": lambda: bd.Segment(CURVES["line"], 1.0, 2.4),
    "^Curve: noise must be positive, got 0": lambda: bd.Curve(points=CIRCLE, noise=0.0),
    "^Curve: noise applies only to points": lambda: bd.Curve(np.sin, x=(0, 1), noise=1e-3),
}


def test_errors_of_curves_are_one_sentence():
    for sentence, call in SENTENCES.items():
        with pytest.raises(bd.BeamdaeError, match=sentence) as caught:
            call()
        assert str(caught.value).endswith("."), sentence


def test_cusp_is_rejected():
    # The tangent of a semicubical parabola reverses at the origin.
    tau = np.linspace(-1.0, 1.0, 81)
    with pytest.raises(bd.BeamdaeError, match="Curve: the curve folds onto itself"):
        bd.Curve(points=np.stack([tau**2, tau**3], axis=-1))


@pytest.mark.parametrize("span", [1e-12, 1e-3, 1e6])
def test_consistency_does_not_depend_on_the_unit_of_length(span):
    assert_consistent(bd.Parabola(span=span, rise=0.3 * span))


def test_regression_angles_in_degrees_have_a_warning():
    """An arc at 45 rad, or a phase of 90 rad, had none."""
    message = r"= 45 rad is more than a full turn; pass radians, such as math\.radians\(45\), or"
    with pytest.warns(bd.BeamdaeWarning, match=f"^Arc: angle {message}"):
        bd.Arc(radius=1.0, length=1.0, start=(0.0, 0.0), angle=45.0)
    with pytest.warns(bd.BeamdaeWarning, match=f"^sine: phase {message}"):
        bd.sine(1.0, 1.0, phase=45.0)
    bd.Arc(radius=1.0, length=1.0, start=(0.0, 0.0), angle=-2.0 * np.pi)


def test_curves_of_many_turns_are_resolved():
    curvature = 2e3
    curve = bd.IntrinsicCurve(lambda s: curvature, 1.0)
    s = np.linspace(0.0, 1.0, 101)
    circle = np.stack([np.sin(curvature * s), 1.0 - np.cos(curvature * s)], axis=-1) / curvature
    assert_allclose(curve.point(s), circle, atol=1e-13)


# Curves through measured points, and warnings about noise and sharp curvature.

ARC = bd.Arc(radius=0.85, length=0.8, start=(0.2, 0.1), angle=-0.6)
STEEL = bd.Material.of("steel")


def measured_points(noise, count=40, seed=1):
    scatter = noise * np.random.default_rng(seed).standard_normal((count, 2))
    return ARC.point(np.linspace(0.0, ARC.length, count)) + scatter


def curvature_error(curve):
    """Return the RMS error of the curvature, relative to that of ARC."""
    fraction = np.linspace(0.0, 1.0, 201)
    error = curve.curvature(fraction * curve.length) * ARC.radius - 1.0
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_smoothing_by_the_noise_recovers_the_curvature(noise):
    through = bd.Curve(points=measured_points(noise))
    curve = bd.Curve(points=measured_points(noise), noise=noise)
    # Measured over five seeds: 0.03 and 0.04; the errors of interpolation are 0.7 and 7.
    assert curvature_error(curve) < 0.1
    assert curvature_error(through) > 5.0 * curvature_error(curve)
    assert_allclose(curve.length, ARC.length, rtol=10.0 * noise)


def test_facts_contain_distances_and_curvature():
    curve = bd.Curve(points=measured_points(1e-4), noise=1e-4)
    facts = curve.facts
    # Where chord lengths follow the points, the noise of both coordinates is across the curve.
    rms = facts["RMS distance of the points from the curve [m]"]
    assert_allclose(rms, np.sqrt(2.0) * 1e-4, rtol=0.03)
    assert 2.0 * rms < facts["largest distance of the points from the curve [m]"] < 4.0 * rms
    assert_allclose(facts["largest curvature [1/m]"], 1.0 / 0.85, rtol=0.2)
    through = bd.Curve(points=measured_points(0.0)).facts
    # Distances to the tangent at the nearest of 2001 points have errors of order step^2 / diameter.
    assert through["largest distance of the points from the curve [m]"] < 1e-7
    assert bd.Segment(curve, 0.1, 0.3).facts == facts
    assert bd.Curve(np.sin, x=(0.0, 1.0)).facts == {}


def test_interpolating_noise_warns():
    with pytest.warns(bd.BeamdaeWarning, match=r"Curve: the curvature .* as noise= \[m\]"):
        bd.Curve(points=measured_points(1e-3))


@pytest.mark.parametrize(
    "points",
    [
        measured_points(0.0),
        measured_points(0.0, count=6),
        measured_points(1e-5),
        [(0.1 * k, 0.2 * k) for k in range(9)],
        [(0.2 * k, 0.1 * np.sin(0.8 * k)) for k in range(9)],
    ],
    ids=["arc", "few", "almost", "straight", "wave"],
)
def test_smooth_points_do_not_warn(points):
    with warnings.catch_warnings():
        warnings.simplefilter("error", bd.BeamdaeWarning)
        bd.Curve(points=points)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: bd.Beam("b", bd.Arc(1.0, 2.0), bd.Section.circle(STEEL, 0.5)),
            "the section height is 0.5 times the radius .* 3.[78] % in the bending stiffness",
        ),
        (
            lambda: bd.Beam("b", bd.Arc(1.0, 2.0), lambda s: bd.Section.circle(STEEL, 0.1 + s)),
            "b: the section height is 2.1 times",
        ),
    ],
)
def test_sharp_curves_warn(make, message):
    with pytest.warns(bd.BeamdaeWarning, match=message):
        make()


def test_gentle_curves_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error", bd.BeamdaeWarning)
        bd.Beam("b", bd.Arc(1.0, 6.0), bd.Section.circle(STEEL, 0.25), elements=8)


@pytest.mark.parametrize("noise", [1e-60, 1e-12, 1.0, 1e60])
def test_extreme_noise_gives_a_curve_or_an_error(noise):
    try:
        curve = bd.Curve(points=measured_points(1e-3), noise=noise)
    except bd.BeamdaeError:
        return
    assert np.isfinite(curve.length)


# Lengths [m] of curves whose curvature jumps, from millimeters to hundreds of meters, and signs.
@pytest.mark.parametrize("length", [1e-3, 1.0, 300.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_curvatures_that_jump_are_refused_and_those_with_kinks_are_integrated(length, sign):
    """Jumps were rounded: the ends of arcs were 1 degree off."""
    with pytest.raises(bd.BeamdaeError, match=f"jumps near s = {0.4 * length:.4g} m"):
        bd.IntrinsicCurve(lambda s: sign * 3.0 / length * (s > 0.4 * length), length)
    kinked = bd.IntrinsicCurve(lambda s: sign * 5.0 * abs(s / length - 0.4) / length, length)
    # The integral of 5 |x - 0.4| from 0 to 1.
    assert_allclose(kinked.tangent_angle(length), sign * 2.5 * (0.16 + 0.36), atol=1e-5)
