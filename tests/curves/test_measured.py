"""Curves through measured points, and warnings about noise and sharp curvature."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd

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
