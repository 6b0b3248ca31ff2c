"""Errors of modes and of linear models."""

import numpy as np
import pytest
from hub_beam import hub_beam
from mechanisms import STEEL, clamped_beam, free_ball, mass_on_rail, rectangle
from numpy.testing import assert_allclose

import beamdae as bd

WRONG, ACCURATE = 0.04, 0.01

ABSOLUTE = "exact"


def shaken_strip(elements, load=0.0, formulation="floating frame"):
    """Return a linear model of a clamped strip with a force at its end."""
    section = rectangle(0.003, damping=2e-5)
    mech, beam = clamped_beam(section, elements, 0.5, name="strip", formulation=formulation)
    mech.add(bd.PointMass("bob", 0.05, on=beam.end))
    mech.add(bd.Force("push", beam.end, (0.0, -load * section.EI / 0.5**2)))
    mech.observe("tip", beam.end)
    mech.observe("stress", beam.stress(0.05, "top"))
    outputs = ["tip.y", "tip.angle", "stress"]
    return bd.linearize(mech, about="equilibrium", inputs=["push.Fy"], outputs=outputs)


def compare(elements, load, formulation, frequencies):
    model, exact = shaken_strip(elements, load, formulation), shaken_strip(12, load, ABSOLUTE)
    diagram, other = (bd.bode(x, frequencies) for x in (model, exact))
    return diagram, other


@pytest.mark.slow(reason="linear models of fine meshes")
@pytest.mark.parametrize("share", [0.3, 0.8, 1.4])
@pytest.mark.parametrize(
    ("elements", "load", "formulation"),
    [
        (1, 0.0, "floating frame"),
        (2, 0.0, ABSOLUTE),
        (6, 2.5, "floating frame"),
        (6, 2.5, ABSOLUTE),
    ],
)
def test_stated_errors_of_single_responses_are_true_errors(elements, load, formulation, share):
    second = 70.0  # Hz
    diagram, exact = compare(elements, load, formulation, [share * second])
    errors = np.abs(diagram.response - exact.response) / np.abs(exact.response)
    errors, stated = errors[0, :, 0], diagram.errors.total
    assert diagram.errors.headers[0] == f"tip.y / push.Fy at {share * second:g} Hz [m/N]"
    wrong, accurate = errors > WRONG, errors < ACCURATE
    assert np.all(stated[wrong] > 0.5 * errors[wrong])
    assert np.all(stated[wrong] < 2.0 * errors[wrong])
    assert np.all(stated[accurate] < WRONG)


@pytest.mark.slow(reason="linear models of fine meshes")
def test_peaks_that_shift_are_errors_of_their_frequencies():
    diagram, exact = compare(1, 0.0, "floating frame", np.geomspace(2.0, 200.0, 200))
    errors = dict(zip(diagram.errors.headers, diagram.errors.total, strict=True))
    first, second = (
        np.sort(x.model.poles.imag[x.model.poles.imag > 0.0]) for x in (diagram, exact)
    )
    assert errors["frequency 2 [Hz]"] == pytest.approx(first[1] / second[1] - 1.0, rel=0.3)
    assert errors["frequency 2 [Hz]"] > WRONG
    # The largest magnitudes are those at the first peak.
    assert errors["tip.y / push.Fy [m/N]"] < ACCURATE
    assert any("frequency 2" in x for x in diagram.warnings)


@pytest.mark.filterwarnings("always::beamdae.BeamdaeWarning")
def test_linear_models_and_responses_warn_of_their_errors():
    with pytest.warns(bd.BeamdaeWarning, match="frequency 3: the error is about 83 % of "):
        model = shaken_strip(1)
    with pytest.warns(bd.BeamdaeWarning, match=r"frequency_response: tip.angle .* at 95 Hz: "):
        model.frequency_response([95.0])


@pytest.mark.slow(reason="a default band of frequencies")
def test_accurate_models_have_no_warning(recwarn):
    model = shaken_strip(8)
    model.frequency_response([1.0, 9.0, 95.0])
    bd.bode(model)
    assert model.errors.largest < 1e-3
    assert not recwarn.list


def test_models_without_a_mechanism_are_not_checked():
    mech, bob = free_ball((1.0, 0.0), mass=2.0, name="bob")
    mech.add(bd.Force("push", bob.point, (0.0, 0.0)))
    errors = bd.linearize(bd.equations_of_motion(mech)).errors
    assert errors.reason == "the model is not a mechanism"


PLASTIC = bd.Material(E=2.6e9, nu=0.36, rho=1230.0)
STRIP = rectangle(0.004)


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


@pytest.mark.slow(reason="a run")
def test_errors_about_an_instant_are_found_without_stiffness_of_the_hub():
    mech = hub_beam(elements=2)
    instant = bd.simulate(mech, bd.Radau(1e-4), t_end=0.2).at(0.2)
    moving, resting = (bd.modes(mech, x, n=4).errors.total for x in (instant, "reference"))
    assert_allclose(moving[-1], resting[-1], rtol=0.01)


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
