"""Errors of derivatives, compared with derivatives of finer models by accurate methods."""

import pickle

import numpy as np
import pytest
from mechanisms import STEEL, clamped_beam, rectangle

import beamdae as bd

FINE = {"elements": 4, "strain": "exact"}


@bd.model(t_end=0.3)
def bent_strip(load=0.02, height=2e-3, elements=1, strain="nonlinear"):
    """Return a clamped strip that a force bends far."""
    section = rectangle(height, 0.01, damping=5e-3)
    mech, beam = clamped_beam(section, elements, strain=strain)
    size = load * STEEL.E * 0.01 * 8e-9
    mech.add(bd.Force("load", beam.end, (0.0, bd.sine(size, 0.8))))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.slow(reason="several runs with sensitivities")
@pytest.mark.parametrize(
    ("method", "cause"),
    [(bd.Radau(1e-5), "mesh"), (bd.GeneralizedAlpha(step=0.01), "time")],
)
def test_errors_of_sensitivities_contain_those_of_mesh_and_steps(method, cause):
    values = FINE if cause == "time" else {}
    coarse = bd.sensitivities(bent_strip, "load", method, parameters=values, estimate_error=False)
    fine = bd.sensitivities(
        bent_strip, "load", bd.Radau(1e-7), parameters=FINE, estimate_error=False
    )
    expected = fine.sensitivity("tip.y", "load")
    error = np.linalg.norm(coarse.sensitivity("tip.y", "load") - expected)
    error /= np.linalg.norm(expected)
    row = coarse.errors.table().loc["d(tip.y)/d(load) [m per unit of load]"]
    assert 0.5 * error < row["total"] < 2.0 * error
    assert row[cause] > 0.5 * row["total"]


@pytest.mark.slow(reason="several runs with gradients")
def test_errors_of_gradients_contain_those_of_the_mesh():
    objective, method = bd.quantities.EndValue("tip.y"), bd.Radau(1e-6)
    names = ["load", "height"]
    coarse = bd.gradient(bent_strip, objective, names, method, estimate_error=False)
    fine = bd.gradient(bent_strip, objective, names, method, parameters=FINE, estimate_error=False)
    sizes = np.array([0.02, 2e-3])
    errors = sizes * np.abs(coarse.array - fine.array) / np.max(sizes * np.abs(fine.array))
    np.testing.assert_allclose(coarse.errors.total[1:], errors, rtol=1.0, atol=1e-3)
    assert coarse.errors.headers[1:] == (
        "d(objective)/d(load) [per unit of load]",
        "d(objective)/d(height) [per unit of height]",
    )


def test_known_errors_are_kept_by_pickle():
    result = bd.sensitivities(bent_strip, "load", bd.GeneralizedAlpha(step=0.01), 0.05)
    known = result.errors.total
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(result)).errors.total, known)


def test_derivatives_from_another_process_are_not_checked():
    method = bd.GeneralizedAlpha(step=0.01)
    result = bd.sensitivities(bent_strip, "load", method, 0.05, estimate_error=False)
    again = pickle.loads(pickle.dumps(result))
    assert again.errors.reason == "the derivatives come from another process"
