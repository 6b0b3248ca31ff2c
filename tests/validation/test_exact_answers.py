"""Orders of the beam formulations, and the runs of the paper by the exact beam."""

import numpy as np
import pandas as pd
import pytest
from formulations.exact_runs import INTEGRATORS, MODELS, RESULTS, TOLERANCES, measure_eight_elements
from formulations.orders import CURVES, ELEMENTS, FORMULATIONS, QUANTITIES, TABLE, relative_errors

ORDERS = pd.read_csv(TABLE)
RUNS = pd.read_csv(RESULTS / "exact_runs.csv", index_col="group")
# Orders of energy, tip and moment: (straight, curved). Twice the degree of the shape functions on a
# straight axis; for moments the order of their interpolation between quadrature points. Curved axes
# are interpolated: the angles of their sections and tangents differ by the fourth order.
EXPECTED = {
    "exact": ((6, 6, 3), (4, 4, 3)),
    "exact, full": ((6, 6, 3), (5, 5, 3)),
    "exact, 3 nodes": ((4, 4, 2), (4, 4, 2)),
    "exact, 2 nodes": ((2, 2, 1), (2, 2, 1)),
    "frame, exact strain": ((6, 6, 3), (4, 4, 3)),
    "frame, green": ((6, 6, 3), (4, 4, 3)),
    # The strains of the paper neglect the curvature.
    "frame, nonlinear": ((np.nan,) * 3, (2, 2, 2)),
    "frame, nonlinear, local": ((np.nan,) * 3, (2, 2, 2)),
}


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("curve", CURVES)
def test_stored_orders_match_theory(curve, formulation):
    rows = ORDERS[(ORDERS["curve"] == curve) & (ORDERS["formulation"] == formulation)]
    assert list(rows["quantity"]) == list(QUANTITIES)
    expected = EXPECTED[formulation][curve != "straight"]
    for observed_order, order in zip(rows["order"], expected, strict=True):
        # Slopes over 8 to 32 elements are below the limit. NaN: rounding errors only.
        assert np.isnan(observed_order) or observed_order > order - 0.35
    finest = rows[f"{ELEMENTS[-1]} elements"]
    assert (finest < rows[f"{ELEMENTS[0]} elements"].clip(lower=1e-12)).all()


@pytest.mark.slow(reason="shooting to 1e-12, and two meshes")
@pytest.mark.parametrize("formulation", ["exact", "frame, exact strain"])
@pytest.mark.parametrize("curve", CURVES)
def test_stored_errors_are_reproduced(curve, formulation):
    rows = ORDERS[(ORDERS["curve"] == curve) & (ORDERS["formulation"] == formulation)]
    for elements in ELEMENTS[:2]:
        stored = rows[f"{elements} elements"].to_numpy()
        # Two digits are stored.
        np.testing.assert_allclose(relative_errors(curve, formulation, elements), stored, rtol=0.06)


def test_formulations_integrators_and_exudyn_agree_on_the_reference():
    known = RUNS.loc["reference"]
    assert set(known["model"]) == set(MODELS)
    # A thirtieth of the tolerance of 8 elements; mostly time errors of the second method.
    assert known["off [mm]"].max() < 3e-4
    stored = RUNS.loc["8 elements"]
    assert len(stored) == len(MODELS) * len(INTEGRATORS)
    assert (stored["off [mm]"] < 1e3 * stored["model"].map(TOLERANCES)).all()


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("label", [x for x in INTEGRATORS if not x.startswith("Ida")])
def test_eight_exact_elements_suffice_for_the_hub_beam(label):
    assert (
        float(measure_eight_elements("hub_beam", label)["off [mm]"]) < 1e3 * TOLERANCES["hub_beam"]
    )


@pytest.mark.slow(reason="5 s of motion by each integrator")
@pytest.mark.parametrize(
    ("name", "label"),
    [("hub_beam", next(iter(INTEGRATORS))), *(("pendulum", label) for label in INTEGRATORS)],
)
def test_eight_exact_elements_suffice_for_all_integrators(name, label):
    assert float(measure_eight_elements(name, label)["off [mm]"]) < 1e3 * TOLERANCES[name]


def test_errors_of_strains_follow_the_order_of_their_theory():
    parting = RUNS.loc["strains"]
    parting = parting[parting["share of the run"] == 1.0].set_index("model")["off [mm]"]
    for name in MODELS:
        linear, paper, green, exact_strain, exact_beam = parting.loc[name]
        assert linear > paper > green > 100.0 * max(exact_strain, exact_beam)
