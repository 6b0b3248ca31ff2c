"""Beams in equilibrium and the spin-up, by both exact formulations, against references."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from benchmarks.equilibria import ELASTICA
from benchmarks.run import SUMMARY
from benchmarks.spin_up_cases import CASE_NAME, SPIN_UP_CASES, STEADY_TOLERANCE, TRANSIENT_TOLERANCE
from benchmarks.static_cases import FORMULATIONS, STATIC_CASES
from benchmarks.static_closed_forms import elastica
from numpy.testing import assert_allclose

STORED = pd.read_csv(SUMMARY)
# P L^2 / EI: M L / EI at the clamp, by shooting.
CLAMP_MOMENTS = {
    1: 0.94356676,
    2: 1.67871656,
    3: 2.23673945,
    4: 2.68423503,
    5: 3.06185820,
    6: 3.39246703,
    7: 3.68950800,
    8: 3.96137814,
    9: 4.21361494,
    10: 4.45004402,
}
# Digits of u / L, w / L and the slope as printed, and of the moment.
DIGITS = (5, 5, 6, 8)


@pytest.mark.parametrize("load", ELASTICA)
def test_closed_form_of_the_elastica_matches_published_values(load):
    published = (*ELASTICA[load], CLAMP_MOMENTS[load])
    for value, printed, digits in zip(elastica(load), published, DIGITS, strict=True):
        assert round(value, digits) == pytest.approx(printed, abs=1e-12)


def case_parameter(case, label):
    # Cases with many elements are slow.
    slow = case.elements > 8
    reason = f"{case.elements} elements"
    marks = [pytest.mark.slow(reason=reason)] if slow else []
    return pytest.param(case, label, id=f"{case.name}, {label}", marks=marks)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    ("case", "label"), [case_parameter(*pair) for pair in product(STATIC_CASES, FORMULATIONS)]
)
def test_equilibrium_matches_reference(case, label):
    for row in case.rows_by(label):
        assert float(row["relative"]) <= case.tolerance, row


def test_table_contains_every_static_case():
    for case in STATIC_CASES:
        rows = STORED[STORED["case"] == case.name]
        settings = {f"{label}, {case.elements} elements" for label in FORMULATIONS}
        assert set(rows["setting"]) == settings
        assert (rows["relative"] <= case.tolerance).all()
        for _, setting_rows in rows.groupby("setting"):
            assert_allclose(
                setting_rows["published"].astype(float), list(case.reference.values()), rtol=1e-12
            )


def test_error_is_independent_of_slenderness():
    rows = STORED[STORED["case"].str.startswith("quarter circle")]
    worst = rows.groupby(["setting", "case"])["relative"].max().unstack()
    assert worst.shape == (2, 6)
    # Shear and extension, which are nearly exact, contribute 2 % at R/h = 4.
    assert (worst.max(axis=1) < 1.05 * worst.min(axis=1)).all()


def check_spin_up_rows(rows):
    for row in rows:
        bound = STEADY_TOLERANCE if row["quantity"] == "extension" else TRANSIENT_TOLERANCE
        assert float(row["relative"]) <= bound, row


def test_stored_spin_up_meets_its_tolerances():
    rows = STORED[STORED["case"] == CASE_NAME]
    assert len(rows) == 5 * len(SPIN_UP_CASES)
    assert np.ptp(rows.groupby("quantity").size()) == 0
    check_spin_up_rows(rows.to_dict("records"))


@pytest.mark.slow(reason="two spin-ups by each integrator")
@pytest.mark.parametrize("case", SPIN_UP_CASES, ids=lambda x: f"{x.formulation}, {x.transient}")
def test_spin_up_matches_reference(case):
    check_spin_up_rows(case.rows())
