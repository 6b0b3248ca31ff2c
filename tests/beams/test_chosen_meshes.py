"""Beams without `elements`: the program chooses meshes that resolve deformations and modes."""

import math
from itertools import pairwise

import numpy as np
import pytest
from mechanisms import clamped_beam
from numpy.testing import assert_allclose

import beamdae as bd

ALLOY = bd.Material(E=7e10, nu=0.33, rho=2700.0)
THICK, THIN = (bd.Section.rectangle(ALLOY, width=0.02, height=x) for x in (0.008, 0.004))
TAPER = bd.taper(bd.Section.rectangle, ALLOY, width=0.02, height=(0.006, 0.002, 0.004))
LINE = bd.Line((0.0, 0.0), (1.0, 0.0))
ARC = bd.Arc(radius=0.5, length=0.9)
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
    [(ARC, THIN, ()), (LINE, TAPER, (0.3,)), (CLOTHOID, THIN, (0.11, 0.9)), (ARC, TAPER, (0.45,))],
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
@pytest.mark.parametrize("curve", [LINE, ARC, CLOTHOID])
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
        beam = bd.Beam("arm", ARC, THIN, **settings)
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
    mech, beam = clamp(ARC, THIN, masses=(0.45,), **settings)
    errors = bd.equilibrium(mech).errors
    assert errors.refined.degrees == {"arm": 6}
    assert str(errors.refined).startswith("a repetition with higher degrees of arm")
    assert errors.largest < 0.01
    assert "accuracy=1e-12" in errors.recommend(1e-12)
    assert shape_of(beam) == (2, 6)
