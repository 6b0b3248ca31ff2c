"""Differences of analyses with respect to parameters, which derivatives are compared with."""

import numpy as np

WEIGHTS = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}


def differentiate(function, model, name, values, relative=1e-3):
    """Return the fourth-order difference of a function of the mechanism by a parameter."""
    value = values.get(name, model.parameters[name])
    delta = relative * value
    return sum(
        weight / delta * np.asarray(function(model(**{**values, name: value + k * delta})))
        for k, weight in WEIGHTS.items()
    )


def assert_close(actual, expected, value, size, tolerance):
    """Compare derivatives; errors are relative to them, or to the size over the parameter."""
    scale = np.maximum(np.abs(size) / abs(value), np.abs(expected))
    error = np.abs(np.asarray(actual) - expected)
    assert np.all(error <= tolerance * scale), error / scale
