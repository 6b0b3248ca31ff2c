"""Properties of all loads: exact tangents and a complete energy balance."""

from __future__ import annotations

import numpy as np
import pytest
from conformance import LOADS
from numpy.testing import assert_allclose
from support import (
    ARC,
    EXACT_VARIANT,
    UNEVEN_ELEMENTS,
    VARIANTS,
    NumericEquations,
    assert_derivative,
)

import beamdae as bd

CHORD = VARIANTS[2]
# Loads that use the whole beam.
OF_BEAMS = ("Rayleigh", "AirDrag", "dead load by length", "pressure", "load by place")
every_load = pytest.mark.parametrize(
    ("make", "variant"),
    [
        pytest.param(
            make,
            variant,
            id=f"{name}, {variant.formulation}",
            marks=[pytest.mark.slow] if variant is EXACT_VARIANT and name not in OF_BEAMS else [],
        )
        for name, make in LOADS.items()
        for variant in (CHORD, EXACT_VARIANT)
    ],
)


def mechanism(variant):
    mech = bd.Mechanism(gravity=(0.2, -1.5))
    disk = mech.add(bd.RigidBody("disk", mass=1.3, inertia=0.7, center=(0.5, 0.4)))
    # A given mesh, so that the load does not change the coordinates.
    return mech, disk, mech.add(variant.beam(ARC, UNEVEN_ELEMENTS))


@pytest.fixture
def loaded(make, variant):
    """Return the equations with the load, and without it."""
    mech, disk, beam = mechanism(variant)
    mech.add(make(mech, disk, beam))
    return NumericEquations(mech, time=(0.7, 0.7)), NumericEquations(
        mechanism(variant)[0], time=(0.7, 0.7)
    )


def state(numeric, seed):
    rng = np.random.default_rng(seed)
    q = numeric.equations.q0 + 0.15 * rng.standard_normal(numeric.n)
    return q, rng.standard_normal(numeric.n), rng.standard_normal(numeric.n)


@every_load
def test_tangents_are_derivatives(loaded):
    numeric, _ = loaded
    q, v, a = state(numeric, 0)
    assert_derivative(numeric.stiffness(q, v, a), lambda x: numeric.force(x, v, a), q)
    assert_derivative(numeric.damping(q, v, a), lambda x: numeric.force(q, x, a), v)
    assert_derivative(numeric.mass(q, v, a), lambda x: numeric.force(q, v, x), a)


@every_load
def test_its_power_is_complete_in_the_energy_balance(loaded):
    """Its share of F . v is the rate of its energies, less its power, plus its dissipation."""
    with_load, without = loaded
    q, v, a = state(with_load, 1)

    def added_energies(at, speed):
        return with_load.energies(at, speed) - without.energies(at, speed)

    def energy(t):
        return added_energies(q + t * v + 0.5 * t**2 * a, v + t * a)[:3].sum()

    h = 1e-3
    rate = (8.0 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12.0 * h)
    power, dissipated = added_energies(q, v)[3:]
    force = with_load.force(q, v, a) - without.force(q, v, a)
    assert np.any(force)
    # Rounding error of energies of order one, divided by the step.
    assert_allclose(force @ v, rate - power + dissipated, rtol=1e-9, atol=1e-9)
    assert dissipated >= 0.0
