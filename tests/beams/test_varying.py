"""Sections that vary along a beam, and beams bent from a stress-free shape."""

from dataclasses import replace

import numpy as np
import pytest
from conformance import INTEGRATORS
from mechanisms import EARTH, clamped_beam
from numpy.testing import assert_allclose
from support import (
    ARC,
    REPRESENTATIVE_VARIANTS,
    NumericEquations,
    parametrize_variants,
    random_state,
)

import beamdae as bd

ALLOY = bd.Material.of("aluminum")
LINE = bd.Line((0.0, 0.0), (1.0, 0.0))
WIDTH, HEIGHTS = 0.03, (0.02, 0.01)


def wedge(s):
    return bd.Section.rectangle(ALLOY, WIDTH, HEIGHTS[0] + (HEIGHTS[1] - HEIGHTS[0]) * s)


TAPER = bd.taper(bd.Section.rectangle, ALLOY, width=WIDTH, height=HEIGHTS)


def cantilever(section, load=-1e-6, curve=LINE, **settings):
    mech, beam = clamped_beam(section, curve=curve, **settings)
    if load:
        mech.add(bd.Force("load", beam.end, (0.0, load)))
    mech.observe("tip", beam.end)
    return mech, beam


@pytest.mark.parametrize("section", [wedge, TAPER], ids=["law", "taper"])
def test_tip_of_a_tapered_cantilever(section):
    # int (1 - s)^2 / (E b h^3 / 12) ds + int 1 / (k G b h) ds with h = h0 + (h1 - h0) s.
    a = HEIGHTS[1] - HEIGHTS[0]
    ratio = HEIGHTS[1] / HEIGHTS[0]
    # 1 - s = (h - h1) / (-a): int (h - h1)^2 / h^3 dh from h1 to h0, over |a|^3.
    bending = (-np.log(ratio) + 2.0 * ratio - 0.5 * ratio**2 - 1.5) / abs(a) ** 3
    shearing = -np.log(ratio) / abs(a)
    exact = -1e-3 * (12.0 / (ALLOY.E * WIDTH) * bending + shearing / (5.0 / 6.0 * ALLOY.G * WIDTH))
    # Measured 1.8e-6 and 3.2e-8, of order 6.
    for elements, error in ((4, 3e-6), (8, 5e-8)):
        mech, _ = cantilever(section, load=-1e-3, elements=elements)
        assert_allclose(bd.equilibrium(mech)["tip.y"].iloc[-1], exact, rtol=error)


def test_dimensions_of_a_taper_are_linear_between_equidistant_points():
    height, width = (0.004, 0.007, 0.002, 0.003), (0.03, 0.01)
    section = bd.taper(bd.Section.rectangle, ALLOY, width=width, height=height)
    beam = bd.Beam("beam", LINE, section, elements=3)
    s = np.linspace(0.0, beam.length, 23)
    sections = [beam.section.at(x) for x in s]
    knots = np.linspace(0.0, beam.length, 4)
    assert_allclose([x.height for x in sections], np.interp(s, knots, height), rtol=1e-14)
    widths = np.interp(s, knots[[0, -1]], width)
    assert_allclose([x.area / x.height for x in sections], widths, rtol=1e-14)


def test_mass_and_rotary_inertia_of_a_taper():
    mech = bd.Mechanism(gravity=EARTH)
    mech.add(bd.Beam("beam", LINE, wedge, elements=3, angular_velocity=2.0))
    numeric = NumericEquations(mech)
    mass = ALLOY.rho * WIDTH * 0.015
    # The integrands s^2 h and h^3 / 12 are polynomials, which are integrated exactly.
    about_start = ALLOY.rho * WIDTH * (0.02 / 3.0 - 0.01 / 4.0)
    rotary = ALLOY.rho * WIDTH / 12.0 * (0.02**4 - 0.01**4) / 0.04
    assert_allclose(-numeric.force()[1], -9.81 * mass, rtol=1e-12)
    kinetic = numeric.energies(v=numeric.equations.v0)[0]
    assert_allclose(kinetic, 0.5 * 4.0 * (about_start + rotary), rtol=1e-12)


@pytest.mark.parametrize(
    ("shape", "published"),
    [
        # Kirchhoff (1879), clamped at the thick end with a sharp tip: 5.315 h / (2 L^2)
        # sqrt(E / (3 rho)) for a wedge and 8.719 r / (2 L^2) sqrt(E / rho) for a cone.
        ((bd.Section.rectangle, {"width": 0.01, "height": (0.01, 1e-6)}), 5.315 / np.sqrt(12.0)),
        ((bd.Section.circle, {"diameter": (0.01, 1e-6)}), 8.719 / 4.0),
    ],
    ids=["wedge", "cone"],
)
def test_first_frequency_of_a_pointed_cantilever(shape, published):
    make, sizes = shape
    mech, _ = cantilever(bd.taper(make, ALLOY, **sizes), load=0.0, elements=12)
    unit = 0.01 * np.sqrt(ALLOY.E / ALLOY.rho)
    # Shear and rotary inertia reduce the frequency by about 1e-4; published digits resolve 2e-4.
    frequency = bd.modes(mech, n=1).eigenvalues[0].imag
    assert_allclose(frequency, published * unit, rtol=8e-4)


@parametrize_variants(REPRESENTATIVE_VARIANTS)
def test_constant_section_law_equals_the_section(variant):
    def equations_with(section):
        mech = bd.Mechanism(gravity=(0.4, -9.81))
        beam = mech.add(variant.beam(ARC, section=section))
        mech.add(bd.RayleighDamping("damping", beam, mass=0.7, stiffness=0.02))
        mech.observe("forces", beam.section_forces(0.7))
        mech.observe("stress", beam.stress(0.7, 0.02))
        return NumericEquations(mech)

    plain, along = equations_with(variant.section), equations_with(lambda s: variant.section)
    q, v, a = random_state(plain, seed=3)
    for what in ("force", "energies", "stiffness", "damping", "mass"):
        actual = getattr(along, what)(q=q, v=v, a=a)
        # Rounding errors only.
        assert_allclose(actual, getattr(plain, what)(q=q, v=v, a=a), rtol=1e-12, atol=1e-11)
    for name in ("forces", "stress"):
        state = {"q": q, "v": v}
        assert_allclose(along.observed(name, **state), plain.observed(name, **state), rtol=1e-13)


def test_free_curve_equal_to_the_drawing_changes_nothing():
    mech, _ = cantilever(wedge, curve=bd.Segment(ARC, 0.0, 1.0))
    free = bd.Segment(ARC, 0.0, 1.0)
    other, _ = cantilever(wedge, curve=free, free_curve=free)
    assert_allclose(NumericEquations(other).force(), NumericEquations(mech).force(), atol=1e-12)


STRIP = bd.Section.rectangle(ALLOY, width=0.02, height=0.001)
BENT = bd.Arc(radius=2.0, length=1.0)


@pytest.mark.parametrize("frame", ["chord", "tangent"])
def test_straight_strip_drawn_as_an_arc_balances_end_moments(frame):
    """M = EI (1/R_free - 1/R) is uniform; strain energy EI L / (2 R^2), stress E h / (2 R)."""
    mech, beam = cantilever(
        STRIP, load=0.0, curve=BENT, free_curve=bd.Line((5.0, 0.0), (5.0, 1.0)), frame=frame
    )
    moment = STRIP.EI / 2.0
    mech.add(bd.Moment("moment", beam.end, moment))
    for s in (0.0, 0.4, 1.0):
        mech.observe(f"forces {s}", beam.section_forces(s))
    mech.observe("top", beam.stress(0.4, "top"))
    mech.observe("bottom", beam.strain(0.4, "bottom"))
    numeric = NumericEquations(mech)
    # Equal and opposite end moments balance the prestrain except for rounding errors.
    rest = bd.modes(mech, n=1)
    assert not any("not an equilibrium" in x for x in rest.warnings)
    for s in (0.0, 0.4, 1.0):
        assert_allclose(numeric.observed(f"forces {s}"), (0.0, 0.0, -moment), atol=1e-12 * moment)
    # The relative arc length error of 8 elements is 4e-8.
    assert_allclose(numeric.energies()[1], STRIP.EI / 8.0, rtol=1e-7)
    assert_allclose(numeric.observed("top"), [-ALLOY.E * 0.0005 / 2.0], rtol=1e-12)
    assert_allclose(numeric.observed("bottom"), [0.0005 / 2.0], rtol=1e-12)


def test_wire_drawn_too_long_is_in_tension():
    line = bd.Line((0.0, 0.0), (1.001, 0.0))
    mech, beam = cantilever(STRIP, load=0.0, curve=line, free_curve=LINE)
    mech.observe("forces", beam.section_forces(0.5))
    assert_allclose(
        NumericEquations(mech).observed("forces"), (STRIP.EA * 1e-3, 0.0, 0.0), rtol=1e-9
    )


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("name", ["ida", "radau", "alpha adaptive"])
def test_released_beam_oscillates_about_its_free_shape(name):
    arc = bd.Arc(radius=5.0, length=1.0)
    strip = replace(STRIP, damping=0.1)
    mech, _ = cantilever(strip, load=0.0, curve=arc, free_curve=LINE, elements=4)
    solution = bd.simulate(mech, INTEGRATORS[name], t_end=8.0, output_step=0.02)
    y = solution.observed["tip.y [m]"].to_numpy()
    assert y[0] == pytest.approx(arc.point(1.0)[1], rel=1e-6)
    # At a damping ratio of a quarter, the overshoot is exp(-0.27 pi), and the amplitude decays as
    # exp(-1.3 t).
    assert -0.5 * y[0] < y.min() < -0.35 * y[0]
    assert abs(y[-1]) < 3e-4 * y[0]
    assert solution.quality.energy_imbalance < 1e-3


def test_welded_beams_share_section_law_and_free_shape():
    free = bd.Line((0.0, 0.0), (1.0, 0.0))
    for section in (wedge, TAPER):
        mech = bd.Mechanism()
        bodies = bd.welded_beams(mech, "strip", BENT, section, 4, free_curve=free, elements=2)
        heights = [beam.section.at(beam.length).height for beam in bodies]
        # Rounding errors only.
        assert_allclose(heights, (0.0175, 0.015, 0.0125, 0.01), rtol=1e-12)
        mech.observe("forces", bodies[2].section_forces(0.25))
        moment = wedge(0.75).EI / 2.0
        # Forces are interpolated by parabolas, but the moment is cubic in the drawn arc.
        assert_allclose(
            NumericEquations(mech).observed("forces"), (0.0, 0.0, -moment), atol=1e-4 * moment
        )


def stepped(s):
    return bd.Section.rectangle(ALLOY, width=0.02, height=0.01 if s < 0.37 else 0.005)


def notched(s):
    depth = 2.0 * (0.005 - np.sqrt(max(0.005**2 - (s - 0.05) ** 2, 0.0)))
    return bd.Section.rectangle(ALLOY, width=0.01, height=0.0005 + depth)


def rectangles(*heights):
    return bd.taper(bd.Section.rectangle, ALLOY, width=0.02, height=heights)


KINKED = rectangles(0.004, 0.0035, 0.0028, 0.002, 0.0007)


def loaded_beam(section, length, elements, load):
    mech, beam = clamped_beam(section, elements, bd.Line((0.0, 0.0), (length, 0.0)))
    if load == "force":
        mech.add(bd.Force("load", beam.end, (0.0, -1e-6)))
    elif load == "moment":
        mech.add(bd.Moment("load", beam.end, -1e-6))
    elif load == "uniform":
        mech.add(bd.DistributedForce("load", beam, (0.0, -1e-6)))
    mech.observe("end", beam.end)
    return mech


@pytest.mark.parametrize(
    ("section", "length", "elements", "load"),
    [
        (stepped, 1.0, 4, "force"),
        (stepped, 1.0, 4, "uniform"),
        (stepped, 1.0, [0.0, 0.25, 0.37, 0.7, 1.0], "force"),
        (notched, 0.1, 8, "force"),
        (rectangles(0.01, 1e-6), 1.0, 4, "uniform"),
        (KINKED, 0.4, 1, "force"),
        (KINKED, 0.4, 2, "uniform"),
        (KINKED, 0.4, 3, "moment"),
    ],
)
def test_errors_of_sections_that_change_within_elements_are_stated(section, length, elements, load):
    """Elements end at the kinks of tapers, but not where functions change."""
    path = bd.equilibrium(loaded_beam(section, length, elements, load))
    beam = bd.Beam("beam", bd.Line((0.0, 0.0), (length, 0.0)), section)
    # The integral of M m / EI with the moment m by a unit force at the end.
    s = (np.arange(20_000) + 0.5) / 20_000 * length
    power, factor = {"force": (2, 1.0), "uniform": (3, 0.5), "moment": (1, 1.0)}[load]
    compliance = [(length - x) ** power / beam.section.at(x).EI for x in s.tolist()]
    exact = -1e-6 * factor * length * np.mean(compliance)
    # Errors are stated relative to the largest value of the path, not to the exact one.
    error = abs(1.0 - exact / float(path["end.y"].iloc[-1]))
    # The shear deformation is at most 1e-3 of the deflection.
    stated = path.errors.table()["total"]["end.y [m]"]
    assert 0.5 * error - 2e-3 < stated < 2.0 * error + 2e-3
    if section is KINKED:
        # The parabolas of the curvature in the last quarter, where EI falls to 4 %.
        assert error < 5e-3
