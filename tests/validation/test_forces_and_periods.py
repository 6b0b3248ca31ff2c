"""Section forces and periodic motions against closed forms, and what is stored of them."""

import pandas as pd
import pytest
from benchmarks.periodic_motions import PERIODIC_CASES
from benchmarks.run import SUMMARY
from benchmarks.section_forces import SECTION_FORCE_CASES
from benchmarks.static_cases import FORMULATIONS
from numpy.testing import assert_allclose

STORED = pd.read_csv(SUMMARY)


def given(case, *slow):
    marks = [pytest.mark.slow(reason="runs of beams")] if case.name in slow else []
    return pytest.param(case, id=case.name, marks=marks)


@pytest.mark.parametrize("label", FORMULATIONS)
@pytest.mark.parametrize("case", [given(case, "rotating rod") for case in SECTION_FORCE_CASES])
def test_known_section_forces_are_met(case, label):
    for row in case.rows_by(label):
        assert float(row["relative"]) <= case.tolerance, row


SLOW = ("shaken cantilever", "peak of a slider-crank over its speed")


@pytest.mark.parametrize("case", [given(case, *SLOW) for case in PERIODIC_CASES])
def test_known_periodic_motions_are_met(case):
    for row in case.rows():
        assert float(row["relative"]) <= case.tolerance, row


@pytest.mark.parametrize("case", [*SECTION_FORCE_CASES, *PERIODIC_CASES], ids=lambda x: x.name)
def test_all_of_them_are_in_the_table(case):
    lines = STORED[STORED["case"] == case.name]
    assert (lines["relative"] <= case.tolerance).all()
    for _, own in lines.groupby("setting"):
        assert_allclose(own["published"].astype(float), list(case.reference.values()), rtol=1e-8)
