"""Section forces and periodic motions against closed forms and the stored table."""

import pandas as pd
import pytest
from benchmarks.periodic_motions import PERIODIC_CASES
from benchmarks.run import SUMMARY
from benchmarks.section_forces import SECTION_FORCE_CASES
from benchmarks.static_cases import FORMULATIONS
from numpy.testing import assert_allclose

STORED = pd.read_csv(SUMMARY)


def case_parameter(case, *slow_names):
    marks = [pytest.mark.slow(reason="runs of beams")] if case.name in slow_names else []
    return pytest.param(case, id=case.name, marks=marks)


SLOW_FORCE_CASES = (
    "rotating rod",
    "rotating ring",
    "stresses of curved bars by plane elasticity",
    "impact wave",
    "falling chimney",
)


@pytest.mark.parametrize("label", FORMULATIONS)
@pytest.mark.parametrize(
    "case", [case_parameter(case, *SLOW_FORCE_CASES) for case in SECTION_FORCE_CASES]
)
def test_section_forces_match_references(case, label):
    for row in case.rows_by(label):
        assert float(row["relative"]) <= case.tolerance, row


SLOW_PERIODIC_CASES = (
    "shaken cantilever",
    "van der Pol",
    "peak of a slider-crank over its speed",
)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "case", [case_parameter(case, *SLOW_PERIODIC_CASES) for case in PERIODIC_CASES]
)
def test_periodic_motions_match_references(case):
    for row in case.rows():
        assert float(row["relative"]) <= case.tolerance, row


@pytest.mark.parametrize("case", [*SECTION_FORCE_CASES, *PERIODIC_CASES], ids=lambda x: x.name)
def test_table_contains_every_case(case):
    rows = STORED[STORED["case"] == case.name]
    assert (rows["relative"] <= case.tolerance).all()
    for _, setting_rows in rows.groupby("setting"):
        assert_allclose(
            setting_rows["published"].astype(float), list(case.reference.values()), rtol=1e-8
        )
