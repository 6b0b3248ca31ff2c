"""Errors of natural modes: stated beside true ones, about states of all kinds."""

import numpy as np
import pytest
from mechanisms import STEEL, clamped_beam, mass_on_rail, rectangle
from numpy.testing import assert_allclose

import beamdae as bd

PLASTIC = bd.Material(E=2.6e9, nu=0.36, rho=1230.0)
STRIP = rectangle(0.004)
WRONG, ACCURATE = 0.04, 0.01


def cantilever(elements, section=STRIP, **settings):
    mech, beam = clamped_beam(section, elements, 0.6, **settings)
    mech.observe("tip", beam.end)
    return mech


def bent_reed(elements, damping=0.0, **settings):
    """Return a reed whose end a force bends by half its length."""
    section = rectangle(0.008, damping=damping, material=PLASTIC)
    mech = cantilever(elements, section, **settings)
    mech.add(bd.Force("load", mech.parts["beam"].end, (0.0, -2.5 * section.EI / 0.6**2)))
    return mech


def blade(elements, speed=0.0, **settings):
    """Return a blade on a hub that turns at `speed` [rad/s]."""
    mech = bd.Mechanism()
    center = mech.ground.at(0.0, 0.0)
    hub = mech.add(bd.RigidBody("hub", mass=1.0, inertia=1.0))
    mech.add(bd.Revolute("bearing", center, hub.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", center, hub.at(0.0, 0.0), lambda t: speed * t))
    line = bd.Line((0.1, 0.0), (0.6, 0.0))
    beam = mech.add(bd.Beam("blade", line, STRIP, elements=elements, **settings))
    mech.add(bd.Weld("clamp", hub.at(0.1, 0.0), beam.start))
    return mech


def about_instant(mech):
    """Return the state of a run whose strong vibration has decayed."""
    return bd.simulate(mech, bd.Radau(1e-4), t_end=1.5).at(1.5)


GREEN, EXACT = {"strain": "green"}, {"formulation": "exact"}


@pytest.mark.slow(reason="a run")
@pytest.mark.parametrize("elements", [1, 4])
def test_errors_about_an_instant_are_those_about_the_equilibrium_that_it_approaches(elements):
    model = bent_reed(elements, damping=1e-2, **(EXACT if elements == 1 else GREEN))
    of_run, of_rest = (bd.modes(model, x, n=20) for x in (about_instant(model), "equilibrium"))
    # The two slowest vibrations; the others decay.
    at_end, at_rest = (x.errors.total[x.eigenvalues.imag > 0.0][:2] for x in (of_run, of_rest))
    assert_allclose(at_end, at_rest, rtol=0.02)
    assert at_end[-1] > WRONG


@pytest.mark.slow(reason="modes of several meshes")
def test_free_motions_at_the_end_of_a_path_are_held():
    mech = bent_reed(2)
    tip = mech.parts["beam"].end
    disk = mech.add(bd.RigidBody.disk("disk", tip.point, radius=0.1, mass=0.2))
    mech.add(bd.Revolute("pin", tip, disk.at(*tip.point)))
    at_end, at_rest = (bd.modes(mech, x, n=3) for x in (bd.equilibrium(mech), "equilibrium"))
    assert at_end.kinds[0] == "free motion"
    assert_allclose(at_end.errors.total, at_rest.errors.total, rtol=1e-3)


@pytest.mark.slow(reason="modes of several meshes")
def test_motions_at_equal_rates_are_paired():
    """A translation in the rotating frame was paired with a free motion."""
    mech = bd.Mechanism()
    circle = bd.Arc(radius=1.0, length=2.0 * np.pi)
    bd.welded_beams(mech, "ring", circle, STRIP, 4, closed=True, elements=4, formulation="exact")
    modes = bd.modes(mech, bd.rotation(5.0, (0.0, 1.0)), n=11)
    assert modes.errors.largest < ACCURATE


@pytest.mark.slow(reason="modes of several meshes")
def test_causes_are_elements_and_strains():
    coarse, strained = (bd.modes(bent_reed(k, **GREEN), "equilibrium", n=3) for k in (1, 6))
    causes = coarse.errors.causes
    assert causes["mesh"][2] > 0.2
    table = strained.errors.table()
    assert list(table) == [
        "value", "companion", "rows", "total", "time", "friction", "mesh", "theory", "status",
    ]  # fmt: skip
    assert np.all(table["mesh"] < 1e-3)
    assert_allclose(table["theory"], table["total"], atol=1e-3)
    assert np.all(table["status"] == "measured")
    (sentence,) = strained.warnings
    assert sentence.startswith("frequency ")
    assert sentence.endswith('use strain="exact" of beam.')


def test_modes_are_paired_by_their_shapes():
    """The second mode of one element is axial: four bending modes of two elements are slower."""
    section = rectangle(0.12)
    coarse = bd.modes(cantilever(1, section), n=3)
    exact = 0.25 * np.sqrt(STEEL.E / STEEL.rho) / 0.6
    axial = int(np.argmin(np.abs(coarse.frequencies / exact - 1.0)))
    # Linear axial strains of one element of four nodes.
    assert abs(coarse.frequencies[axial] / exact - 1.0) < 1e-3
    assert coarse.errors.total[axial] < 2e-3
    assert coarse.errors.total[axial - 1] > WRONG or coarse.errors.total[axial + 1] > WRONG


@pytest.mark.parametrize(("radius", "exact"), [(0.5, 25.05), (2.0, 29.0), (20.0, 29.31)])
def test_vibrations_that_an_element_lacks_are_errors(radius, exact):
    """The first mode of one element was an axial one of 376 Hz with an error of 3 %."""
    mech, beam = clamped_beam(rectangle(0.002), 1, bd.Arc(radius=radius, length=1.0))
    mech.add(bd.Weld("right clamp", mech.ground.at(*beam.end.point), beam.end))
    modes = bd.modes(mech, n=1)
    assert modes.frequencies[0] > 1.3 * exact
    assert modes.errors.companions[0] == pytest.approx(exact, rel=0.05)


def test_modes_that_cannot_be_refined_are_exact_or_not_checked():
    mech, _ = mass_on_rail(2.0, 1.0, spring=(8.0,))
    assert bd.modes(mech).errors.largest == 0.0
    equations = bd.equations_of_motion(mech)
    (status,) = bd.modes(equations).errors.statuses
    assert status == "not checked: the model is not a mechanism"
    named = bd.modes(cantilever(2), {"beam.x0": 0.0}, n=2)
    assert set(named.errors.statuses) == {"not checked: no refined model: no beam can be refined"}
    assert not named.warnings


@pytest.mark.slow(reason="modes of several meshes")
@pytest.mark.filterwarnings("always::beamdae.BeamdaeWarning")
def test_modes_and_campbell_diagrams_warn_of_requested_modes_only():
    with pytest.warns(bd.BeamdaeWarning, match=r"frequency 2: .* halved elements of blade"):
        bd.modes(blade(1), n=2)
    diagram = bd.campbell(blade(1), [0.0, 20.0, 50.0], n=2)
    (warning,) = diagram.warnings
    assert "frequency 2: " in warning
    assert "frequency 3" not in warning
    assert not bd.campbell(blade(1), [0.0, 50.0], n=1).warnings
