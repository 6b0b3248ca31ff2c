"""Equilibria of what is far softer in one direction than in another: free, or only thin."""

import pytest

import beamdae as bd


def strip(elements, height, joint=bd.Weld, **words):
    """A steel strip of 1 m at the ground, under its weight."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    own = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=height)
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (1.0, 0.0)), own, elements, **words))
    mech.add(joint("held", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech


WORDS = pytest.mark.parametrize(
    "words", [{"formulation": "exact"}, {"strain": "exact"}], ids=["exact", "in a frame"]
)


@WORDS
@pytest.mark.filterwarnings("error::beamdae.errors.BeamdaeWarning")
@pytest.mark.parametrize(("elements", "height"), [(10, 5e-5), (20, 1e-4)])
def test_a_thin_strip_is_not_free(words, elements, height):
    # Its bending is 1e-12 and less of the stiffness of an element against stretching.
    path = bd.equilibrium(strip(elements, height, **words), to=1e-4)
    assert path.status.success
    assert path.stable
    # rho A g L^4 / (8 EI) by a ten thousandth of the weight.
    steel = bd.Material.of("steel")
    known = -1e-4 * 9.81 * steel.rho / (8.0 * steel.E * height**2 / 12.0)
    assert path.columns["tip.y [m]"][-1] == pytest.approx(known, rel=1e-3)


@pytest.mark.slow(reason="half a second and more")
@WORDS
def test_what_hangs_free_comes_down(words):
    # Of more coordinates than matrices are taken as a whole for; a frame turns without stiffness.
    path = bd.equilibrium(strip(20, 1e-2, joint=bd.Revolute, **words))
    assert path.stable
    assert path.columns["tip.y [m]"][-1] == pytest.approx(-1.0, abs=1e-5)
