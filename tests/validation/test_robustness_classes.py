"""Registered classes of robustness trials: samples, counts and lost processes."""

from dataclasses import dataclass

import pandas as pd
import pytest
from robustness.classes import CLASSES, load_class
from robustness.trial_class import TrialClass, count_outcomes


@dataclass(frozen=True)
class Row:
    trial: str
    ended: str
    complaint: str


def letters(**settings):
    return TrialClass("letters", lambda: list("abcdefgh"), str, 1.0, quick_size=3, **settings)


def test_sample_is_reproducible_and_keeps_the_order():
    trials = letters()
    assert trials.sample(None, 0) == trials.sample(8, 0) == list("abcdefgh")
    assert trials.sample(3, 0) == sorted(trials.sample(3, 0))
    assert len(trials.sample(3, 0)) == 3
    assert trials.sample(3, 0) != trials.sample(3, 1)
    assert trials.sample(3, 0, "c") == ["c"]


def test_lost_process_is_a_complaint_unless_the_trial_is_hopeless():
    assert letters().rows_of("a", None)[0]["complaint"] == "it crashed"
    assert letters().rows_of("a", ...)[0]["complaint"] == "it hung"
    excused = letters(hopeless=lambda name: "never returns" if name == "a" else "")
    assert excused.rows_of("a", ...)[0]["ended"] == "hopeless: never returns"
    assert excused.rows_of("b", ...)[0]["complaint"] == "it hung"


def test_outcomes_are_counted_by_class():
    rows = [
        Row("a", "ran", ""),
        Row("b", "skipped: no chromium", ""),
        Row("c", "hopeless: never returns", ""),
        Row("d", "ran", "off by 2 %"),
    ]
    counts = count_outcomes("letters", pd.DataFrame(rows), 1.0)
    assert (counts.trials, counts.right, counts.skipped) == (4, 1, 1)
    assert (counts.hopeless, counts.not_right) == (1, 1)
    assert count_outcomes("letters", pd.DataFrame(), 1.0).trials == 0


@pytest.mark.parametrize("name", CLASSES)
def test_registered_class_is_importable_and_can_be_sent_to_processes(name):
    trials = load_class(name)
    # Worker processes receive the function by its name.
    assert "<" not in trials.attempt.__qualname__
    assert trials.quick_size > 0
