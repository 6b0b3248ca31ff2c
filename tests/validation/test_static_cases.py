"""Beams at rest and spun up, by both exact formulations, against published and closed forms."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from benchmarks.run import SUMMARY
from benchmarks.spin_up_cases import CASE_NAME, SPIN_UP_CASES, STEADY_TOLERANCE, TRANSIENT_TOLERANCE
from benchmarks.static_cases import FORMULATIONS, STATIC_CASES
from benchmarks.static_closed_forms import elastica
from numpy.testing import assert_allclose

STORED = pd.read_csv(SUMMARY)
# P L^2 / EI: u / L, w / L, slope [rad], M L / EI, as printed by K. Mattiasson, Int. J. Numer.
# Methods Eng. 17 (1981) 145; the last one by shooting.
PRINTED = {
    1: (0.05643, 0.30172, 0.461352, 0.94356676),
    2: (0.16064, 0.49346, 0.781750, 1.67871656),
    3: (0.25442, 0.60325, 0.986017, 2.23673945),
    4: (0.32894, 0.66996, 1.121239, 2.68423503),
    5: (0.38763, 0.71379, 1.215368, 3.06185820),
    6: (0.43459, 0.74457, 1.283697, 3.39246703),
    7: (0.47293, 0.76737, 1.334960, 3.68950800),
    8: (0.50483, 0.78498, 1.374432, 3.96137814),
    9: (0.53182, 0.79906, 1.405465, 4.21361494),
    10: (0.55500, 0.81061, 1.430286, 4.45004402),
}


@pytest.mark.parametrize("load", PRINTED)
def test_the_closed_form_is_what_is_printed(load):
    for value, printed, digits in zip(elastica(load), PRINTED[load], (5, 5, 6, 8), strict=True):
        assert round(value, digits) == pytest.approx(printed, abs=1e-12)


def tried(case, label):
    # Where they are costly: of many elements, and of two circles.
    slow = case.elements > 8
    reason = f"{case.elements} elements"
    marks = [pytest.mark.slow(reason=reason)] if slow else []
    return pytest.param(case, label, id=f"{case.name}, {label}", marks=marks)


@pytest.mark.parametrize(
    ("case", "label"), [tried(*one) for one in product(STATIC_CASES, FORMULATIONS)]
)
def test_what_is_known_of_a_beam_at_rest_is_met(case, label):
    for row in case.rows_by(label):
        assert float(row["relative"]) <= case.tolerance, row


def test_every_known_rest_is_in_the_table():
    for case in STATIC_CASES:
        lines = STORED[STORED["case"] == case.name]
        settings = {f"{label}, {case.elements} elements" for label in FORMULATIONS}
        assert set(lines["setting"]) == settings
        assert (lines["relative"] <= case.tolerance).all()
        for _, own in lines.groupby("setting"):
            assert_allclose(
                own["published"].astype(float), list(case.reference.values()), rtol=1e-12
            )


def test_locking_does_not_come_with_slenderness():
    lines = STORED[STORED["case"].str.startswith("quarter circle")]
    worst = lines.groupby(["setting", "case"])["relative"].max().unstack()
    assert worst.shape == (2, 5)
    # At R/h = 2500 a linear system with entries 1e8 apart is rounded at a few 1e-7.
    assert (worst.max(axis=1) < 2.0 * worst.min(axis=1)).all()


def tolerance(rows):
    for row in rows:
        bound = STEADY_TOLERANCE if row["quantity"] == "extension" else TRANSIENT_TOLERANCE
        assert float(row["relative"]) <= bound, row


def test_the_table_of_the_spin_up_keeps_its_bounds():
    lines = STORED[STORED["case"] == CASE_NAME]
    assert len(lines) == 5 * len(SPIN_UP_CASES)
    assert np.ptp(lines.groupby("quantity").size()) == 0
    tolerance(lines.to_dict("records"))


@pytest.mark.slow(reason="two spin-ups by each integrator")
@pytest.mark.parametrize("case", SPIN_UP_CASES, ids=lambda x: f"{x.formulation}, {x.transient}")
def test_the_spin_up_is_that_of_the_exact_beam(case):
    tolerance(case.rows())
