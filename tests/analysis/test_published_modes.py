"""Natural frequencies against published values and Rayleigh-Ritz solutions."""

import numpy as np
import pytest
from benchmarks import mode_closed_forms as closed_forms
from benchmarks.modes import (
    EISENBERGER,
    FORMULATIONS,
    WRIGHT,
    arch_section,
    ring,
    square_rubber,
    supported_beam,
)
from mechanisms import rectangle
from numpy.testing import assert_allclose

import beamdae as bd


def ritz(speed):
    """Return flapping frequencies of a thin rotating cantilever, by the Rayleigh-Ritz method.

    Spin softening lowers w^2 in the plane of rotation only, by the square of the speed.
    """
    return np.hypot(closed_forms.rotating_cantilever(speed, 0.0, 3), speed)


@pytest.mark.parametrize("speed", [0.0, 1.0, 5.0])
def test_waves_of_one_period_are_translations_of_a_spinning_ring(speed):
    """Bryan's formula for n = 1: seen from the ring, a resting ring circles at its speed."""
    waves = closed_forms.spinning_thin_ring(arch_section(), 1.0, 1, speed)
    assert_allclose(waves, speed)


def test_published_arch_frequencies_solve_its_equations():
    section, length = arch_section(), 0.5 * np.pi
    unit = length**2 * np.sqrt(section.rhoA / section.EI)
    exact = unit * closed_forms.hinged_arch(section, 1.0, length, np.array(EISENBERGER) / unit)
    assert_allclose(exact, EISENBERGER, rtol=0.0, atol=5.1e-4)


@pytest.mark.parametrize("speed", WRIGHT)
def test_published_frequencies_of_rotating_arms_match_ritz(speed):
    assert_allclose(ritz(speed), WRIGHT[speed], rtol=2e-5)


@pytest.mark.slow(reason="rings of two heights")
def test_ring_converges_to_the_thin_ring():
    """The effects of shear, rotary inertia and axial strain grow with the height squared."""
    steel = bd.Material(E=2e11, nu=0.3, rho=8000.0)
    deviations = []
    for height in (0.02, 0.01):
        section = rectangle(height, material=steel)
        frequency = bd.modes(ring(section, 1.0, 16), n=5).eigenvalues[3].imag
        deviations.append(1.0 - frequency / closed_forms.thin_ring(section, 1.0, 2))
    # The mesh error is 4e-6 of the frequency.
    assert_allclose(deviations[0] / deviations[1], 4.0, rtol=0.2)


@pytest.mark.slow(reason="512 elements")
@pytest.mark.parametrize("formulation", FORMULATIONS.values())
def test_twenty_modes_of_a_fine_mesh_match_the_closed_form(formulation):
    """512 elements with the sparse solver; rounding of their stiffness leaves ten digits."""
    many = bd.modes(supported_beam(512, formulation), n=20).eigenvalues.imag
    expected = closed_forms.supported_beam(square_rubber(), 2.0, 20)
    assert_allclose(many, expected, rtol=1e-8)
