"""Runs of a required accuracy: stored true errors, and one case that runs again."""

import warnings
from pathlib import Path

import pandas as pd
import pytest
import required_accuracy.run as validation
from tolerances.cases import ALL

import beamdae as bd

RESULTS = Path(validation.__file__).parent / "results"


def stored_tables():
    return [pd.read_csv(RESULTS / f"{name}.csv") for name in ("columns", "runs")]


def test_stored_errors_are_below_the_accuracy():
    summary = validation.summarize(*stored_tables())
    assert summary["mechanisms"].min() == len(validation.CASES)
    assert summary["within accuracy"].min() == 1.0
    assert summary["stated within a factor 2"].min() >= 0.9


def test_wrong_errors_are_noticed():
    columns, runs = stored_tables()
    columns["true"] = 2.0 * columns["accuracy"]
    assert validation.summarize(columns, runs)["within accuracy"].max() == 0.0


@pytest.mark.slow(reason="two refined runs and two references")
def test_a_hub_beam_reaches_the_accuracy():
    (case,) = (case for case in ALL if case.name == "hub_beam")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        columns, runs = map(pd.DataFrame, validation.run_case(case))
    summary = validation.summarize(columns, runs)
    assert list(summary["reached"]) == [1, 1]
    assert list(summary["within accuracy"]) == [1.0, 1.0]
