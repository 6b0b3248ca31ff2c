"""Section stiffness and inertia from materials and shapes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from support import Numeric

import beamdae as bd

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
sizes = st.floats(1e-4, 1.0)
ROUNDING = {"rtol": 1e-14}


@given(width=sizes, height=sizes)
def test_rectangle(width, height):
    section = bd.Section.rectangle(ALLOY, width=width, height=height)
    area, second = width * height, width * height**3 / 12.0
    assert_allclose(section.EA, 68.95e9 * area, **ROUNDING)
    assert_allclose(section.EI, 68.95e9 * second, **ROUNDING)
    assert_allclose(section.GA, 5.0 / 6.0 * 68.95e9 / 2.6 * area, **ROUNDING)
    assert_allclose(section.rhoA, 2760.0 * area, **ROUNDING)
    assert_allclose(section.rhoI, 2760.0 * second, **ROUNDING)
    assert section.damping == 0.0


@given(diameter=sizes)
def test_circle_has_the_second_moment_of_its_points(diameter):
    section = bd.Section.circle(ALLOY, diameter)
    # int y^2 dA and int dA over strips of width 2 sqrt(r^2 - y^2); the midpoint rule on 2000
    # strips is good to 1e-4 with the square root at the rim.
    edge = np.linspace(-0.5, 0.5, 2001) * diameter
    y = 0.5 * (edge[1:] + edge[:-1])
    strips = 2.0 * np.sqrt((0.5 * diameter) ** 2 - y**2) * np.diff(edge)
    assert_allclose(section.area, strips.sum(), rtol=1e-4)
    assert_allclose(section.second_moment, (y**2) @ strips, rtol=1e-4)
    assert_allclose(section.shear_coefficient, 7.8 / 8.8, **ROUNDING)


def test_ring_of_a_published_benchmark():
    # NAFEMS R0015, Test 6 (in-plane modes of a free ring): first bending frequency 53.382 Hz with
    # R = 1 m, from w = n (n^2 - 1) / sqrt(n^2 + 1) sqrt(EI / (rhoA R^4)), n = 2.
    section = bd.Section.circle(bd.Material(E=2e11, nu=0.3, rho=8000.0), 0.1)
    frequency = 6.0 / np.sqrt(5.0) * np.sqrt(section.EI / section.rhoA) / (2.0 * np.pi)
    assert_allclose(frequency, 53.382, rtol=1e-5)  # published to five digits


@given(nu=st.floats(-0.99, 0.5))
def test_shear_modulus(nu):
    material = bd.Material(E=3.0, nu=nu, rho=1.0)
    assert_allclose(2.0 * material.G * (1.0 + nu), 3.0, **ROUNDING)


def test_mass_and_inertia_per_length_may_be_given():
    """Simo & Vu-Quoc's spin-up beam: EA, GA, EI, rho A and rho I of no one material and shape."""
    own = bd.Section(
        ALLOY, 1e-4, 1e-8, mass_per_length=1.2, rotary_inertia_per_length=6e-4, damping=0.1
    )
    plain = bd.Section(ALLOY, 1e-4, 1e-8, damping=0.1)
    assert (own.rhoA, own.rhoI) == (1.2, 6e-4)
    assert (own.EA, own.GA, own.EI) == (plain.EA, plain.GA, plain.EI)
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (10.0, 0.0)), own, angular_velocity=2.0))
    numeric = Numeric(mech)
    kinetic = numeric.energies(v=numeric.equations.v0)[0]
    # Of the rod about its start, and of its sections.
    assert_allclose(kinetic, 0.5 * (1.2 * 1000.0 / 3.0 + 6e-4 * 10.0) * 4.0, rtol=1e-12)
    assert_allclose(-numeric.force()[1], -9.81 * 12.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: bd.Material(E=0.0, nu=0.3, rho=1.0), "Material: E must be positive, got 0"),
        (lambda: bd.Material(E=-2.0, nu=0.3, rho=1.0), "Material: E must be positive, got -2"),
        (lambda: bd.Material(E=np.nan, nu=0.3, rho=1.0), "Material: E must be finite, got nan"),
        (lambda: bd.Material(E="stiff", nu=0.3, rho=1.0), "E must be a number, got 'stiff'"),
        (lambda: bd.Material(E=1.0, nu=0.3, rho=-1.0), "Material: rho must be positive, got -1"),
        (lambda: bd.Material(E=1.0, nu=0.51, rho=1.0), r"nu must lie in \(-1, 0.5\], got 0.51"),
        (lambda: bd.Material(E=1.0, nu=-1.0, rho=1.0), r"nu must lie in \(-1, 0.5\], got -1"),
        (lambda: bd.Section(ALLOY, 0.0, 1.0), "Section: area must be positive, got 0"),
        (lambda: bd.Section(ALLOY, 1.0, -1.0), "Section: second_moment must be positive, got -1"),
        (lambda: bd.Section(ALLOY, 1.0, 1.0, 0.0), "shear_coefficient must be positive, got 0"),
        (
            lambda: bd.Section(ALLOY, 1.0, 1.0, damping=-1e-4),
            "Section: damping must not be negative, got -0.0001",
        ),
        (
            lambda: bd.Section(ALLOY, 1.0, 1.0, mass_per_length=0.0),
            "Section: mass_per_length must be positive, got 0",
        ),
        (
            lambda: bd.Section(ALLOY, 1.0, 1.0, rotary_inertia_per_length=0.0),
            "Section: rotary_inertia_per_length must be positive, got 0",
        ),
        (
            lambda: bd.Section.rectangle(ALLOY, width=-0.03, height=0.01),
            "Section.rectangle: width must be positive, got -0.03",
        ),
        (
            lambda: bd.Section.rectangle(ALLOY, width=0.03, height=np.inf),
            "Section.rectangle: height must be finite, got inf",
        ),
        (lambda: bd.Section.circle(ALLOY, 0.0), "Section.circle: diameter must be positive, got 0"),
        (
            lambda: bd.Section("alloy", 1.0, 1.0),
            "Section: material must be a Material, got 'alloy'",
        ),
        (lambda: bd.Section.circle(3, 1.0), "Section.circle: material must be a Material, got 3"),
    ],
)
def test_refusals(make, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        make()
