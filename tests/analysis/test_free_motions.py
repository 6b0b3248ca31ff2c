"""Free motions of thin structures: counted exactly, with and without damping, at rest and turning.

The rounding errors of the axial stiffness of a thin beam exceed the squared frequencies of slow
vibrations, and they split the double zero eigenvalues of free motions.
"""

import numpy as np
import pytest
from mechanisms import STEEL, hinged, rectangle
from numpy.testing import assert_allclose

import beamdae as bd

# Roots of cos(x) cosh(x) = 1: frequencies of a free beam are x^2 / (2 pi L^2) sqrt(EI / rhoA).
FREE_BEAM_ROOTS = np.array([4.730040745, 7.853204624, 10.995607838])
# Number of free motions by support.
SUPPORTS = {"free": 3, "hinged": 1, "guided": 1, "sliding hinge": 2}
FORMULATIONS = {"exact": {"formulation": "exact"}, "floating frame": {}}


def strip(support, height, damping, elements=8, material=STEEL, length=1.0, **options):
    """Return a steel strip with structural damping [s] on the given support."""
    mech = bd.Mechanism()
    section = rectangle(height, 0.02 * length, damping=damping, material=material)
    line = bd.Line((0.0, 0.0), (length, 0.0))
    beam = mech.add(bd.Beam("strip", line, section, elements, **options))
    origin = mech.ground.at(0.0, 0.0)
    if support == "hinged":
        mech.add(bd.Revolute("support", origin, beam.start))
    if support == "guided":
        mech.add(bd.Prismatic("support", origin, beam.start))
    if support == "sliding hinge":
        mech.add(bd.PointOnLine("support", origin, beam.start))
    return mech


@pytest.mark.parametrize(
    ("height", "damping"),
    [
        (1e-3, 1e-5),
        *(
            pytest.param(height, damping, marks=pytest.mark.slow(reason="a second each"))
            for height in (1e-1, 5e-3, 1e-3, 2e-4)
            for damping in (0.0, 1e-5)
            if (height, damping) != (1e-3, 1e-5)
        ),
    ],
)
@pytest.mark.parametrize("support", SUPPORTS)
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.filterwarnings(
    "error::beamdae.errors.BeamdaeWarning",
    "ignore:(frequency|growth rate) .* the error is|errors. not checked",
)
def test_free_motions_do_not_depend_on_the_number_of_modes(formulation, support, height, damping):
    mech = strip(support, height, damping, **FORMULATIONS[formulation])
    reference = None
    for n in (1, 3, 4, 6, 8, 10, 12, None):
        modes = bd.modes(mech, n=n)
        count = SUPPORTS[support] if n is None else min(n, SUPPORTS[support])
        assert np.sum(modes.eigenvalues == 0.0) == count
        assert "unstable" not in modes.kinds
        vibrations = modes.eigenvalues[count:][:1]
        if reference is None and len(vibrations):
            reference = vibrations
        elif len(vibrations):
            # Rounding of the axial stiffness is 1e-5 of the lowest squared frequency at 0.2 mm.
            assert_allclose(vibrations.imag, reference.imag, rtol=1e-4)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_damped_free_strip_has_the_frequencies_of_theory(formulation):
    mech = strip("free", 1e-3, 1e-5, **FORMULATIONS[formulation])
    modes = bd.modes(mech, n=6)
    section = rectangle(1e-3)
    expected = FREE_BEAM_ROOTS**2 * np.sqrt(section.EI / section.rhoA)
    # The mesh of eight elements raises the third frequency by 8e-5.
    assert_allclose(np.abs(modes.eigenvalues[3:]), expected, rtol=1e-4)
    # Damping proportional to the stiffness: the decay rate is damping * frequency^2 / 2.
    assert_allclose(-modes.eigenvalues[3:].real, 0.5e-5 * expected**2, rtol=2e-4)


def hub_with_booms(height):
    """Return a free hub with two thin elastic booms."""
    mech = bd.Mechanism()
    section = rectangle(height, damping=1e-5)
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01, (0.0, 0.0)))
    for name, side in (("right", 1.0), ("left", -1.0)):
        line = bd.Line((0.1 * side, 0.0), (1.1 * side, 0.0))
        boom = mech.add(bd.Beam(name, line, section, 8, formulation="exact"))
        mech.add(bd.Weld(f"{name} root", hub.at(0.1 * side, 0.0), boom.start))
    return mech


@pytest.mark.parametrize("height", [1e-2, 1e-3, 1e-4])
def test_free_hub_with_thin_booms_has_three_free_motions_and_rests(height):
    modes = bd.modes(hub_with_booms(height), n=6)
    assert np.sum(modes.eigenvalues == 0.0) == 3
    # Rounding errors of the booms accelerate the hub, which has no stiffness of its own.
    assert modes.warnings == ()


def ring(height, damping, formulation):
    """Return a free circular ring of two halves."""
    radius, section = 0.2, rectangle(height, damping=damping)
    mech = bd.Mechanism()
    one, other = (
        mech.add(
            bd.Beam(
                name,
                bd.Arc(radius, np.pi * radius, start=(x, 0.0), angle=angle),
                section,
                # The exact ring uses sparse matrices, the other dense ones.
                12 if formulation == "exact" else 4,
                formulation=formulation,
            )
        )
        for name, x, angle in (("upper", radius, 0.5 * np.pi), ("lower", -radius, -0.5 * np.pi))
    )
    mech.add(bd.Weld("left", one.end, other.start))
    mech.add(bd.Weld("right", other.end, one.start))
    return mech


@pytest.mark.slow(reason="half a second each")
@pytest.mark.parametrize("damping", [0.0, 1e-6])
@pytest.mark.parametrize("height", [1e-2, 1e-3])
@pytest.mark.parametrize("speed", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_spinning_free_ring_is_neutral(height, damping, speed, formulation):
    # The translations of a free body are a double eigenvalue at the speed of the frame.
    modes = bd.modes(ring(height, damping, formulation), about=bd.rotation(speed), n=8)
    assert "unstable" not in modes.kinds
    assert modes.kinds.count("free motion") == 1
    translations = np.sort(np.abs(np.abs(modes.eigenvalues) - speed))[:2]
    # The square root of rounding errors splits the pair, by at most 1e-2 1/s.
    assert np.all(translations < 1e-2)


def rotor(is_clamped, formulation="exact"):
    """Return a hub on a shaft with a blade, which is not clamped if its joint is forgotten."""
    mech, hub = hinged(bd.RigidBody.disk("hub", (0.0, 0.0), 0.1, mass=5.0))
    section = rectangle(0.005, 0.03)
    line = bd.Line((0.1, 0.0), (0.6, 0.0))
    blade = mech.add(bd.Beam("blade", line, section, elements=2, formulation=formulation))
    if is_clamped:
        mech.add(bd.Weld("clamp", hub.at(0.1, 0.0), blade.start))
    return mech


@pytest.mark.parametrize("formulation", ["exact", "floating frame"])
def test_regression_rotations_name_bodies_without_a_joint(formulation):
    """No steady state of a rotation had no reason."""
    mech = rotor(False, formulation)
    assert set(bd.modes(mech, n=4).kinds) == {"free motion"}
    with pytest.raises(bd.BeamdaeError, match="because no joint or spring holds blade; add"):
        bd.campbell(mech, [10.0])


@pytest.mark.slow(reason="half a second")
def test_free_motions_of_held_mechanisms_and_of_free_structures_have_no_warning():
    # With warnings as errors: the rotation of a hub, and a structure that is free as a whole.
    assert bd.modes(rotor(True), n=2).warnings == ()
    assert bd.modes(strip("free", 0.005, 0.0), n=4).warnings == ()
