"""Equilibria of slender structures: very soft in bending, but not free to move."""

import pytest

import beamdae as bd


def strip(elements, height, joint=bd.Weld, **options):
    """Return a horizontal steel strip of 1 m on a joint, under its weight."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=height)
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (1.0, 0.0)), section, elements, **options))
    mech.add(joint("support", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


FORMULATIONS = pytest.mark.parametrize(
    "options", [{"formulation": "exact"}, {"strain": "exact"}], ids=["exact", "floating frame"]
)


@FORMULATIONS
@pytest.mark.filterwarnings("error::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(("elements", "height"), [(10, 5e-5), (20, 1e-4)])
def test_thin_strip_is_not_free(options, elements, height):
    # Its bending stiffness is at most 1e-12 of the axial stiffness of an element.
    path = bd.equilibrium(strip(elements, height, **options), to=1e-4)
    assert path.status.success
    assert path.stable
    # rho A g L^4 / (8 EI) under 1e-4 of the weight.
    steel = bd.Material.of("steel")
    expected = -1e-4 * 9.81 * steel.rho / (8.0 * steel.E * height**2 / 12.0)
    assert path.columns["tip.y [m]"][-1] == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow(reason="half a second and more")
@FORMULATIONS
def test_hinged_strip_hangs_down(options):
    # The model exceeds the limit for dense matrices; the frame rotates without stiffness.
    path = bd.equilibrium(strip(20, 1e-2, joint=bd.Revolute, **options))
    assert path.stable
    assert path.columns["tip.y [m]"][-1] == pytest.approx(-1.0, abs=1e-5)
