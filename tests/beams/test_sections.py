"""Section stiffness and inertia from materials and shapes."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mechanisms import EARTH, clamped_beam, rectangle
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
sizes = st.floats(1e-4, 1.0)
ROUNDING = {"rtol": 1e-14}


@pytest.mark.slow(reason="a fifth of a second")
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
    # int y^2 dA and int dA over 2000 strips of width 2 sqrt(r^2 - y^2); the error of the midpoint
    # rule is below 1e-4 despite the square root at the rim.
    edge = np.linspace(-0.5, 0.5, 2001) * diameter
    y = 0.5 * (edge[1:] + edge[:-1])
    strips = 2.0 * np.sqrt((0.5 * diameter) ** 2 - y**2) * np.diff(edge)
    assert_allclose(section.area, strips.sum(), rtol=1e-4)
    assert_allclose(section.second_moment, (y**2) @ strips, rtol=1e-4)
    assert_allclose(section.shear_coefficient, 7.8 / 8.8, **ROUNDING)


@given(outer=sizes, share=st.floats(0.01, 0.499))
def test_pipe_is_the_difference_of_two_circles(outer, share):
    pipe = bd.Section.pipe(ALLOY, outer, wall=share * outer)
    whole = bd.Section.circle(ALLOY, outer)
    hole = bd.Section.circle(ALLOY, outer * (1.0 - 2.0 * share))
    # For a wall of 1 % of the diameter, the difference is 4 % of the terms.
    assert_allclose(pipe.area, whole.area - hole.area, rtol=1e-13)
    assert_allclose(pipe.second_moment, whole.second_moment - hole.second_moment, rtol=1e-13)


def test_shear_coefficient_of_a_pipe_between_circle_and_thin_wall():
    full, thin = (bd.Section.pipe(ALLOY, 1.0, wall).shear_coefficient for wall in (0.499999, 1e-6))
    assert_allclose(full, bd.Section.circle(ALLOY, 1.0).shear_coefficient, rtol=1e-9)
    # Cowper (1966), thin-walled round tube: 2 (1 + nu) / (4 + 3 nu).
    assert_allclose(thin, 2.6 / 4.9, rtol=1e-9)


def test_i_profile_of_a_steel_table():
    """IPE 200: the table includes fillets of 12 mm, which add 123 mm^2 and 0.97e-6 m^4."""
    steel = bd.Material.of("steel")
    profile = bd.Section.i_profile(steel, width=0.1, height=0.2, flange=0.0085, web=0.0056)
    fillets = (4.0 - np.pi) * 0.012**2
    arm = 0.1 - 0.0085 - 0.012 * (10.0 - 3.0 * np.pi) / (12.0 - 3.0 * np.pi)
    assert_allclose(profile.area + fillets, 28.48e-4, rtol=2e-4)
    # The second moment of the fillets about their centroids, 1e-4 of the total, is neglected.
    assert_allclose(profile.second_moment + fillets * arm**2, 19.43e-6, rtol=2e-3)


def test_shear_coefficient_of_an_i_profile_by_the_energy_of_its_shear_flow():
    """At nu = 0, Cowper's value follows from the shear energy: 1 / k = A / I^2 int S^2 / t ds."""
    b, h, flange, web = 0.1, 0.19, 0.0085, 0.0056
    x, w = np.polynomial.legendre.leggauss(4)
    # Thin walls: static moments of the outer part of a flange and of the part above a height.
    out, up = 0.25 * b * (1.0 + x), 0.25 * h * (1.0 + x)
    in_flange, in_web = flange * out * h / 2.0, b * flange * h / 2.0 + web * (h**2 / 4 - up**2) / 2
    energy = 4.0 * 0.25 * b * (w @ in_flange**2) / flange + 2.0 * 0.25 * h * (w @ in_web**2) / web
    area, second = 2.0 * b * flange + web * h, b * flange * h**2 / 2.0 + web * h**3 / 12.0
    soft = bd.Material(E=1.0, nu=0.0, rho=1.0)
    profile = bd.Section.i_profile(soft, width=b, height=h + flange, flange=flange, web=web)
    assert_allclose(profile.shear_coefficient, second**2 / (area * energy), rtol=1e-12)


def test_offsets_of_top_and_bottom():
    strip = bd.Section.rectangle(ALLOY, width=0.03, height=0.004)
    assert (strip.fiber_offset("b", "top"), strip.fiber_offset("b", "bottom")) == (0.002, -0.002)
    assert strip.at(0.3) is strip


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("steel", (210e9, 0.3, 7850.0, None)),
        ("steel S355", (210e9, 0.3, 7850.0, 355e6)),
        ("aluminum", (70e9, 0.3, 2700.0, None)),
        ("titanium Ti-6Al-4V", (113.8e9, 0.342, 4430.0, 830e6)),
    ],
)
def test_materials_by_name(name, numbers):
    material = bd.Material.of(name)
    assert (material.E, material.nu, material.rho, material.yield_stress) == numbers


@given(nu=st.floats(-0.99, 0.5))
def test_shear_modulus(nu):
    material = bd.Material(E=3.0, nu=nu, rho=1.0)
    assert_allclose(2.0 * material.G * (1.0 + nu), 3.0, **ROUNDING)


def test_mass_and_inertia_per_length_override_the_material():
    """In Simo & Vu-Quoc's spin-up beam, rho A and rho I do not follow from one material."""
    section = bd.Section(
        ALLOY, 1e-4, 1e-8, mass_per_length=1.2, rotary_inertia_per_length=6e-4, damping=0.1
    )
    plain = bd.Section(ALLOY, 1e-4, 1e-8, damping=0.1)
    assert (section.rhoA, section.rhoI) == (1.2, 6e-4)
    assert (section.EA, section.GA, section.EI) == (plain.EA, plain.GA, plain.EI)
    mech = bd.Mechanism(gravity=EARTH)
    mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (10.0, 0.0)), section, angular_velocity=2.0))
    numeric = NumericEquations(mech)
    kinetic = numeric.energies(v=numeric.equations.v0)[0]
    # Inertia of the rod about its start, and rotary inertia of its sections.
    assert_allclose(kinetic, 0.5 * (1.2 * 1000.0 / 3.0 + 6e-4 * 10.0) * 4.0, rtol=1e-12)
    assert_allclose(-numeric.force()[1], -9.81 * 12.0, rtol=1e-12)


def test_regression_the_beginning_of_the_name_of_a_material_suffices():
    assert bd.Material.of("titanium") == bd.Material.of("titanium Ti-6Al-4V")
    for name in ("aluminium", "alumini", "alum"):
        assert bd.Material.of(name) == bd.Material.of("aluminum")
    assert bd.Material.of("aluminium 6082").yield_stress == 250e6
    assert bd.Material.of("stainless") == bd.Material.of("stainless steel")
    for name in ("ti", "st", "steel S", "", 3):
        with pytest.raises(bd.BeamdaeError, match=r"^Material\.of: the name must be one of"):
            bd.Material.of(name)


@pytest.mark.parametrize(
    ("E", "rho", "words"),
    [
        (210e3, 7850.0, "those of steel in MPa and kg/m^3; pass E in Pa"),
        (210.0, 7.85, "steel in GPa and g/cm^3"),
        (206e3, 7.85e-9, "steel in MPa and t/mm^3"),
        (70e9, 2.7, "aluminum in Pa and g/cm^3"),
        (10e6, 0.0975, "aluminum in psi and lb/in^3"),
    ],
)
def test_regression_materials_in_other_units_have_a_warning(E, rho, words):
    """Steel with E = 210000 Pa was softer than rubber, in silence."""
    with pytest.warns(bd.BeamdaeWarning, match=re.escape(words)):
        bd.Material(E=E, nu=0.3, rho=rho)


def test_regression_moduli_above_that_of_diamond_have_a_warning():
    """E = 5e12 Pa, by mixed labels of inches and psi, was accepted in silence."""
    with pytest.warns(bd.BeamdaeWarning, match=r"E = 5e\+12 Pa is larger than that of diamond"):
        bd.Material(E=5e12, nu=0.3, rho=7850.0)


@pytest.mark.parametrize(
    ("E", "rho"),
    [
        (1.25e12, 3510.0),
        (0.7e6, 5540.0),
        (210e9, 7850.0),
        (1e3, 1.0),
        (68.95e9, 2760.0),
        (2e3, 950.0),
    ],
)
def test_soft_materials_have_no_warning(E, rho):
    """The rubber of a benchmark of pendulums, numbers without units, and soft foam."""
    assert bd.Material(E=E, nu=0.3, rho=rho).E == E


@pytest.mark.parametrize(("gravity", "unit"), [(9810.0, "mm"), (-386.1, "in"), (32.2, "ft")])
def test_regression_gravity_in_other_units_has_a_warning(gravity, unit):
    with pytest.warns(bd.BeamdaeWarning, match=rf"of the earth in {unit}/s\^2"):
        bd.Mechanism(gravity=(0.0, gravity))


@pytest.mark.parametrize("gravity", [9.81, 1.62, 100.0, 98.1, 0.0])
def test_gravity_of_other_planets_and_centrifuges_has_no_warning(gravity):
    assert bd.Mechanism(gravity=(0.0, gravity)).gravity[1] == gravity


# Angles of sections as drawn.

SECTION = rectangle(0.01)


@pytest.mark.parametrize("frame", ["tangent", "chord"])
@pytest.mark.parametrize("elements", [2, 4])
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_section_of_an_arc_is_normal_to_the_curve(formulation, elements, frame):
    # The axis interpolated by two elements of a half circle is 0.03 rad off at its end.
    options = {"formulation": formulation, "frame": frame}
    mech, beam = clamped_beam(SECTION, elements, bd.Arc(1.0, np.pi), name="arc", **options)
    mech.observe("end", beam.end)
    mech.observe("middle", beam.at(1.0))
    columns = bd.equilibrium(mech).columns
    assert columns["end.angle [rad]"][-1] == pytest.approx(np.pi, abs=1e-12)
    assert columns["middle.angle [rad]"][-1] == pytest.approx(1.0, abs=1e-12)
