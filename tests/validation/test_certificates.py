"""Certificates of the validation: stored results, and one case that runs again."""

import warnings
from pathlib import Path

import certificates.run as validation
import pandas as pd
import pytest
from tolerances.cases import ALL

import beamdae as bd

RESULTS = Path(validation.__file__).parent / "results"


def test_stored_certificates_are_true_and_cover_their_errors():
    tables = [pd.read_csv(RESULTS / f"{name}.csv") for name in ("columns", "certificates")]
    summary = validation.summarize(*tables)
    assert summary["mechanisms"].sum() >= 2 * 46
    assert summary["false certificates"].eq(0).all()
    assert summary["within budget"].min() >= 0.95
    assert summary["cost, median"].max() <= 4.0
    assert {"held out", "tuned"} == set(summary["set"])


def test_a_wrong_budget_is_noticed():
    columns, certificates = (
        pd.read_csv(RESULTS / f"{name}.csv") for name in ("columns", "certificates")
    )
    columns["true error"] = 2.0 * columns["accuracy"]
    summary = validation.summarize(columns, certificates)
    assert summary["within budget"].max() == 0.0
    assert summary["false certificates"].min() > 0


@pytest.mark.slow(reason="four certificates and two references")
def test_a_certified_hub_beam_is_within_its_budget():
    (case,) = (case for case in ALL if case.name == "hub_beam")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        columns, certificates = map(pd.DataFrame, validation.run_case(case))
    summary = validation.summarize(columns, certificates)
    assert list(summary["certified"]) == [1, 1]
    assert list(summary["within budget"]) == [1.0, 1.0]
