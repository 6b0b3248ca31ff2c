"""Errors of frequency responses: stated beside true ones."""

import numpy as np
import pytest
from mechanisms import clamped_beam, free_ball, rectangle

import beamdae as bd

WRONG, ACCURATE = 0.04, 0.01
EXACT = "exact"


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
    model, exact = shaken_strip(elements, load, formulation), shaken_strip(12, load, EXACT)
    diagram, other = (bd.bode(x, frequencies) for x in (model, exact))
    return diagram, other


@pytest.mark.slow(reason="linear models of fine meshes")
@pytest.mark.parametrize("share", [0.3, 0.8, 1.4])
@pytest.mark.parametrize(
    ("elements", "load", "formulation"),
    [(1, 0.0, "floating frame"), (2, 0.0, EXACT), (6, 2.5, "floating frame"), (6, 2.5, EXACT)],
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
