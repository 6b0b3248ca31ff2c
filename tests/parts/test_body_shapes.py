"""Mass, center and inertia of rigid bodies from their shapes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import EARTH
from numpy.testing import assert_allclose

import beamdae as bd

STEEL = {"density": 7850.0, "thickness": 0.01}
L_SHAPE = [(0.0, 0.0), (0.3, 0.0), (0.3, 0.1), (0.1, 0.1), (0.1, 0.2), (0.0, 0.2)]
places = st.tuples(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0))


def test_rod():
    rod = bd.RigidBody.rod("rod", (1.0, 2.0), (4.0, 6.0), density=7850.0, area=1e-4)
    assert_allclose(rod.mass, 7850.0 * 5.0 * 1e-4, rtol=1e-15)
    assert_allclose(rod.inertia, rod.mass * 25.0 / 12.0, rtol=1e-15)
    assert rod.center == (2.5, 4.0)
    assert bd.RigidBody.rod("rod", (1.0, 2.0), (4.0, 6.0), mass=3.0).inertia == 6.25


def test_disk():
    disk = bd.RigidBody.disk("disk", (1.0, -1.0), 0.2, **STEEL, angular_velocity=3.0)
    assert_allclose(disk.mass, 7850.0 * 0.01 * np.pi * 0.04, rtol=1e-15)
    assert_allclose(disk.inertia, disk.mass * 0.02, rtol=1e-15)
    assert (disk.center, disk.angular_velocity) == ((1.0, -1.0), 3.0)


@given(center=places, angle=st.floats(-7.0, 7.0), sizes=st.tuples(*[st.floats(0.01, 5.0)] * 2))
def test_a_plate_is_the_polygon_of_its_corners(center, angle, sizes):
    plate = bd.RigidBody.plate("plate", center, *sizes, angle=angle, mass=2.0)
    polygon = bd.RigidBody.polygon("plate", plate.shape, mass=2.0)
    assert_allclose(plate.inertia, 2.0 * (sizes[0] ** 2 + sizes[1] ** 2) / 12.0, rtol=1e-14)
    # Rounding error of the coordinates, 2e-15 m, in plates of 0.01 m.
    assert_allclose(polygon.inertia, plate.inertia, rtol=1e-9)
    assert_allclose(polygon.center, center, atol=1e-13)


def test_a_polygon_is_the_sum_of_its_rectangles():
    whole = bd.RigidBody.polygon("angle", L_SHAPE, **STEEL)
    parts = [
        bd.RigidBody.plate("a", (0.15, 0.05), 0.3, 0.1, **STEEL),
        bd.RigidBody.plate("b", (0.05, 0.15), 0.1, 0.1, **STEEL),
    ]
    mass = sum(part.mass for part in parts)
    center = sum(part.mass * np.array(part.center) for part in parts) / mass
    apart = [np.sum((np.array(part.center) - center) ** 2) for part in parts]
    inertia = sum(p.inertia + p.mass * d for p, d in zip(parts, apart, strict=True))
    # Rounding error.
    assert_allclose(whole.mass, mass, rtol=1e-13)
    assert_allclose(whole.center, center, rtol=1e-13)
    assert_allclose(whole.inertia, inertia, rtol=1e-13)


@given(turn=st.floats(-7.0, 7.0), by=places, first=st.integers(0, 5), backwards=st.booleans())
def test_a_polygon_has_the_same_mass_properties_at_any_place_and_orientation(
    turn, by, first, backwards
):
    reference = bd.RigidBody.polygon("angle", L_SHAPE, **STEEL)
    c, s = np.cos(turn), np.sin(turn)
    outline = np.roll(L_SHAPE, first, axis=0)[:: -1 if backwards else 1] @ [(c, s), (-s, c)] + by
    body = bd.RigidBody.polygon("angle", outline, **STEEL)
    # Rounding error of the coordinates, 2e-15 m, relative to 0.1 m.
    assert_allclose((body.mass, body.inertia), (reference.mass, reference.inertia), rtol=1e-11)
    center = np.array(reference.center) @ [(c, s), (-s, c)] + by
    assert_allclose(body.center, center, atol=1e-13)


def test_polygons_of_any_size():
    for scale in (1e-6, 1e6):
        body = bd.RigidBody.polygon("angle", scale * np.array(L_SHAPE), mass=1.0)
        reference = bd.RigidBody.polygon("angle", L_SHAPE, mass=1.0)
        assert_allclose(body.inertia, reference.inertia * scale**2, rtol=1e-13)


def test_a_shape_is_the_outline_of_the_body():
    mech = bd.Mechanism(gravity=EARTH)
    body = mech.add(bd.RigidBody.polygon("angle", L_SHAPE, **STEEL))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.2), body.at(0.0, 0.2)))
    assert [place.point for place in body.draw([], 13).places] == L_SHAPE
    solution = bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=0.5)
    assert solution.quality.energy_imbalance < 1e-5
    assert bd.equations_of_motion(mech).length == pytest.approx(np.hypot(0.3, 0.2))
