"""Published natural frequencies, and those of what turns by a computation of its own."""

import numpy as np
import pandas as pd
import pytest
from benchmarks.modes import KNOWN_MODES, WRIGHT, ring, rotating_arm, supported_beam, thin_ring
from benchmarks.run import SUMMARY
from numpy.polynomial import Chebyshev, Polynomial
from numpy.testing import assert_allclose
from scipy.linalg import eigh

import beamdae as bd

STORED = pd.read_csv(SUMMARY)


def ritz(speed, terms=14):
    """First frequencies of a thin rotating cantilever across its plane, by Rayleigh and Ritz.

    Of 1/2 int y''^2 + W^2 (1 - x^2) / 2 y'^2 - w^2 y^2 dx with unit EI, rho A and length, in
    y = x^2 T_k(2 x - 1).
    """
    shapes = [Polynomial([0.0, 0.0, 1.0])]
    for k in range(1, terms):
        inner = Chebyshev.basis(k).convert(kind=Polynomial)(Polynomial([-1.0, 2.0]))
        shapes.append(Polynomial([0.0, 0.0, 1.0]) * inner)
    x, weight = np.polynomial.legendre.leggauss(2 * terms + 4)
    x, weight = 0.5 * (x + 1.0), 0.5 * weight
    y, slope, bend = (np.array([s.deriv(d)(x) if d else s(x) for s in shapes]) for d in (0, 1, 2))
    stiffness = (bend * weight) @ bend.T
    stiffness += speed**2 * (slope * weight * 0.5 * (1.0 - x**2)) @ slope.T
    return np.sqrt(eigh(stiffness, (y * weight) @ y.T, eigvals_only=True)[:3])


def known(case, **marks):
    slow = case.elements > 16
    return pytest.param(
        case,
        id=case.name,
        marks=[pytest.mark.slow(reason="more than 16 elements")] if slow else [],
    )


@pytest.mark.parametrize("case", [known(case) for case in KNOWN_MODES if "arm" not in case.name])
def test_published_frequencies_are_met(case):
    stored = STORED[STORED["case"] == case.name]
    rows = list(case.rows())
    assert [float(row["published"]) for row in rows] == list(stored["published"].astype(float))
    for row, line in zip(rows, stored.to_dict("records"), strict=True):
        assert float(row["relative"]) <= case.within
        # Rounding of slender structures.
        assert_allclose(float(row["ours"]), float(line["ours"]), rtol=1e-7)


def test_every_known_mode_is_in_the_table():
    found = STORED[STORED["setting"].str.startswith("modes")]
    assert set(found["case"]) == {case.name for case in KNOWN_MODES}
    for case in KNOWN_MODES:
        assert (found[found["case"] == case.name]["relative"] <= case.within).all()


@pytest.mark.parametrize("speed", WRIGHT)
def test_published_numbers_of_rotating_arms_are_those_of_ritz(speed):
    assert_allclose(ritz(speed), WRIGHT[speed], rtol=2e-5)


@pytest.mark.parametrize("speed", [2.0, 12.0])
def test_a_thin_rotating_arm_is_that_of_ritz(speed):
    """In the plane of rotation it is softer by the square of the speed."""
    found = bd.modes(rotating_arm(1e3, 8), about=bd.rotation(speed), n=3).eigenvalues
    # Shear, rotary inertia and stretch of a slenderness of 1000: 1e-6 (k pi)^2, and the mesh.
    assert_allclose(np.sqrt(found.imag**2 + speed**2), ritz(speed), rtol=2.5e-4)
    assert_allclose(found.real, 0.0, atol=1e-9)


def test_a_ring_is_thin_in_the_limit():
    """What shear, rotary inertia and stretch take goes with the square of the height."""
    steel = bd.Material(E=2e11, nu=0.3, rho=8000.0)
    off = []
    for height in (0.02, 0.01):
        section = bd.Section.rectangle(steel, width=0.02, height=height)
        own = bd.modes(ring(section, 1.0, 16), n=5).frequencies[3]
        off.append(1.0 - own / thin_ring(section, 1.0, np.array([2.0]))[0])
    # The mesh leaves 4e-6 of the frequency.
    assert_allclose(off[0] / off[1], 4.0, rtol=0.2)


@pytest.mark.slow(reason="512 elements")
def test_twenty_modes_of_many_elements_are_those_of_few():
    """512 elements, by the sparse solver; rounding of their stiffness leaves ten digits."""
    many = bd.modes(supported_beam(512), n=20).eigenvalues.imag
    exact = [95.633980881, 280.320625133, 332.234513637, 635.696288366]
    assert_allclose(many[:4], exact, rtol=1e-9)
    # Closed form: bending w^4 rhoA rhoI / GA - w^2 (rhoA + ...) + EI b^4 = 0, axial (n - 1/2) pi c.
    section = supported_beam(1).part("beam").section
    b = np.pi / 2.0 * np.arange(1, 40)
    inertia, shear = (
        section.rhoA * section.rhoI / section.GA,
        section.EI * section.rhoA / section.GA,
    )
    middle = section.rhoA + section.rhoI * b**2 + shear * b**2
    root = np.sqrt(middle**2 - 4.0 * inertia * section.EI * b**4)
    bending = np.sqrt(np.concatenate([middle - root, middle + root]) / (2.0 * inertia))
    axial = np.sqrt(section.EA / section.rhoA) * np.pi * (np.arange(20) + 0.5) / 2.0
    # The sections may also turn against each other without any deflection.
    pure = np.sqrt(section.GA / section.rhoI)
    known = np.sort(np.concatenate([bending, axial, [pure]]))[:20]
    assert_allclose(many, known, rtol=1e-8)
