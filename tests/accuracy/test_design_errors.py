"""Errors of designs, compared with analyses of exact beams with four times the elements."""

import pytest
from mechanisms import STEEL, cantilever, rectangle

import beamdae as bd
from beamdae import quantities

WIDTH = 0.01


@bd.model(t_end=1.0)
def bent_strip(height=2e-3, elements=1, strain="nonlinear"):
    """Return a clamped strip that a force bends far."""
    section = rectangle(height, WIDTH, damping=1e-3)
    return cantilever(elements, 1.0, section, (0.0, -0.1 * STEEL.E * WIDTH * 8e-9), strain=strain)


def optimize(limit, **parameters):
    bounds = {"height": (1e-3, 4e-3)}
    return bd.optimize(
        bent_strip, quantities.Mass(), "height", limit, bounds, parameters=parameters
    )


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("limit", [0.5, 0.52])
def test_errors_of_limited_values_are_true(limit):
    with pytest.warns(bd.BeamdaeWarning, match=r"tip.x.*: the error is about .* of its value"):
        design = optimize(quantities.at_least(quantities.EquilibriumValue("tip.x"), limit))
    finer = bd.equilibrium(bent_strip(**design.parameters, elements=4, strain="exact"))
    error = abs(finer["tip.x"].iloc[-1] / limit - 1.0)
    table = design.errors.table()
    row = table.iloc[1]
    assert error > 0.04
    assert 0.5 * error < row["total"] < 2.0 * error
    assert row["value"] == pytest.approx(limit, rel=1e-5)
    # The mass does not depend on the elements.
    assert table["total"].iloc[0] == pytest.approx(0.0, abs=1e-9)
    assert next(design.errors.sentences()) in design.warnings


@pytest.mark.slow(reason="half a second")
def test_accurate_designs_have_no_sentence():
    limit = quantities.at_least(quantities.EquilibriumValue("tip.y"), -0.5)
    design = optimize(limit, elements=4, strain="exact")
    assert design.errors.largest < 0.01
    assert design.warnings == ()


def test_designs_without_analyses_are_not_checked():
    size = quantities.ParameterFunction(lambda height: height, "height")
    design = bd.optimize(bent_strip, size, "height", [], {"height": (1e-3, 4e-3)})
    assert design.errors.reason == "no quantity depends on steps or beams"
