"""Rules of validation/robustness: accepted and rejected outcomes, coverage, isolation."""

import os
import sys
import warnings

import numpy as np
import pytest
from isolated_trials import run_trial
from robustness import mechanisms, random_parts
from robustness.faults.bench import CommandResult, WrongBehaviorError, expect_exit
from robustness.inputs import catalog
from robustness.inputs.bad_input import BadInput, try_input
from robustness.isolation import ProcessPool
from robustness.judge import (
    MAX_SENTENCE_LENGTH,
    TrialOutcome,
    check_sentence,
    find_complaint,
    outcome_of_command,
)

import beamdae as bd

RIGHT = "beam: elements must be a whole number of at least 1, got 0."


@pytest.mark.parametrize(
    "sentence",
    [
        RIGHT,
        "hinge: the two points must meet, but ground at (0, 0) and beam at (1, 0) are 1 m apart.",
        "run: no parameter 'a. B', the parameters are mass.",
        "Arc: radius must be finite, got 1e+308.",
        "torque: the law failed, TypeError: f() takes 0 positional arguments but 1 was given.",
    ],
)
def test_sentence_is_accepted(sentence):
    assert check_sentence(sentence) == ""
    assert find_complaint(TrialOutcome("refused", sentence)) == ""


@pytest.mark.parametrize(
    ("sentence", "complaint"),
    [
        ("beam: it is wrong. Take another.", "two sentences"),
        ("beam: it is wrong", "period"),
        ("beam: it must be a number, got <object object at 0x7fb2bb26e190>.", "address"),
        ("beam: it failed: .../casadi/core/sx_elem.cpp:166: no truth value.", "another library"),
        ("beam: it failed: setting an array element with a sequence.", "another library"),
        ("beam: it failed: maximum recursion depth exceeded.", "another library"),
        (f"beam: it must be a number, got '{'x' * MAX_SENTENCE_LENGTH}'.", "characters"),
        ("beam\x1b[31m: it is wrong.", "control characters"),
    ],
)
def test_message_that_is_no_sentence_is_rejected(sentence, complaint):
    assert complaint in find_complaint(TrialOutcome("refused", sentence))


@pytest.mark.parametrize(
    ("outcome", "complaint"),
    [
        (TrialOutcome("crashed"), "crashed"),
        (TrialOutcome("hung"), "hung"),
        (TrialOutcome("raised", "TypeError: 'int' object is not iterable"), "raised"),
        (TrialOutcome("refused", f"{RIGHT}\n{RIGHT}"), "2 lines"),
        (TrialOutcome("refused", ""), "0 lines"),
        (TrialOutcome("failed", ""), "no reason"),
        (TrialOutcome("ran", output="RuntimeWarning: overflow"), "output beside"),
        (TrialOutcome("ran", files=("core",)), "files are left"),
    ],
)
def test_other_outcomes_are_rejected(outcome, complaint):
    assert complaint in find_complaint(outcome)


def test_refusal_names_the_part_or_argument():
    assert find_complaint(TrialOutcome("refused", RIGHT), ["beam"]) == ""
    assert "names neither" in find_complaint(TrialOutcome("refused", RIGHT), ["element", "bea"])


def test_progress_is_no_message():
    """Slow runs report it, for example while machine code is compiled on a loaded machine."""
    lines = "Auto(rtol=1e-05): 0/0.02 s, -:-- left\nRadau(rtol=1e-05): 0.01/0.02 s, 1:05 left\n"
    assert outcome_of_command(0, "table", f"{lines}3 of 9 runs, 1 running\n") == TrialOutcome("ran")
    for text in ("0/0.02 s, -:-- left", "Auto: 3 s left", "left: nothing"):
        assert outcome_of_command(0, "table", text).output == text


def test_command_outcome_follows_from_exit_code_and_standard_error():
    assert outcome_of_command(0, "table", "") == TrialOutcome("ran")
    assert outcome_of_command(2, "", f"error: {RIGHT}\n") == TrialOutcome("refused", RIGHT)
    assert outcome_of_command(1, "table", "failed: time limit of 2 s\n") == TrialOutcome(
        "failed", "time limit of 2 s"
    )
    assert outcome_of_command(1, "", "Traceback (most recent call last):\nE: x\n").ended == "raised"
    assert outcome_of_command(-11, "", "").ended == "crashed"
    assert "output beside" in find_complaint(
        outcome_of_command(2, "half a table", f"error: {RIGHT}")
    )
    box = "Usage: beamdae run\nTry 'beamdae --help'\n╭─ Error ─╮\n│ No such │\n│ option │\n╰───╯\n"
    assert outcome_of_command(2, "", box) == TrialOutcome("refused", "No such option.")


@pytest.mark.slow(reason="starts worker processes")
def test_process_that_dies_or_hangs_is_replaced():
    names = ["first", "dies", "hangs", "exits", "last"]
    with ProcessPool(1) as processes:
        results = dict(processes.run_trials(run_trial, names, 0.5))
    assert results == {"first": "first", "dies": None, "hangs": ..., "exits": None, "last": "last"}


def _try(attempt, **settings):
    return try_input(BadInput("place", "value", attempt, **settings))


def test_output_warnings_and_files_of_an_attempt_are_recorded():
    def loud(words):
        os.write(2, b"from below\n")
        sys.stdout.write("from above\n")
        warnings.warn("of numpy", RuntimeWarning, stacklevel=1)
        with open("left.txt", "w"):
            pass

    outcome, complaint = _try(loud)
    assert outcome.output.splitlines() == ["from below", "from above", "RuntimeWarning: of numpy"]
    assert outcome.files == ("left.txt",)
    assert "output beside" in complaint


def test_attempt_is_refused_by_a_beamdae_error_alone():
    def refused(words):
        words.add("beam")
        raise bd.BeamdaeError(RIGHT)

    assert _try(refused) == (TrialOutcome("refused", RIGHT), "")
    assert "raised ZeroDivisionError" in _try(lambda words: 1 / 0)[1]
    assert "raised SystemExit" in _try(lambda words: exit(0))[1]


@pytest.mark.slow(reason="half a second and more")
def test_every_public_name_has_a_working_call(monkeypatch):
    assert catalog.list_uncovered_names() == []
    monkeypatch.setattr(bd, "__all__", ["Weld", "Lever", "Arc"])
    assert catalog.list_uncovered_names() == ["Lever"]
    monkeypatch.delitem(catalog.WORKING_CALLS, "Weld")
    monkeypatch.setattr(bd, "Arc", lambda radius, length, start, angle, turns: None)
    assert catalog.list_uncovered_names() == ["Weld", "Lever", "Arc(turns=)"]


@pytest.mark.slow(reason="half a second")
def test_sample_has_each_value_of_each_public_name(monkeypatch):
    values = {name: catalog.BAD_VALUES[name] for name in ("nan", "None", "object")}
    monkeypatch.setattr(catalog, "BAD_VALUES", values)
    inputs = {x.name: x for x in catalog.argument_inputs()}
    sample = catalog.sample_inputs(inputs, seed=3)
    kinds = {(inputs[name].group, inputs[name].value) for name in sample}
    assert kinds == {(x.group, x.value) for x in inputs.values()}
    assert len(sample) == len(kinds)
    assert catalog.sample_inputs(inputs, seed=3) == sample
    assert catalog.sample_inputs(inputs, seed=4) != sample


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        ({}, ""),
        ({"imbalance": 0.2}, "energies do not close"),
        ({"imbalance": np.nan}, "energies do not close"),
        ({"imbalance": 0.2, "warnings": "beam: it bends far."}, ""),
        ({"error": 101.0}, "101 rtol off"),
        ({"error": 101.0, "warnings": "tip: the estimated error is 0.1."}, ""),
        ({"ended": "failed", "reason": "the residual is not finite"}, ""),
        ({"ended": "failed", "reason": ""}, "it ended failed"),
        ({"ended": "interrupted", "reason": "by the user"}, "it ended interrupted"),
    ],
)
def test_run_balances_its_energy_and_is_accurate_or_warns(row, complaint):
    right = {"ended": "ok", "error": 50.0, "column": "tip.x [m]", "imbalance": 1e-3}
    message = mechanisms.find_run_complaint(
        mechanisms.MechanismRow("0", "ball", "Auto", **{**right, **row})
    )
    assert complaint in message
    assert bool(message) == bool(complaint)


def test_random_mechanisms_are_reproducible_and_contain_every_addition():
    names = [name for seed in range(300) for name in random_parts.describe_mechanism(seed)[1]]
    assert set(names) == set(random_parts.ADDITIONS)
    first, again = (list(random_parts.random_mechanism(seed=3).parts) for _ in range(2))
    assert first == again


def test_fault_is_judged_by_exit_code_and_messages():
    assert expect_exit(CommandResult(2, "", f"error: {RIGHT}", 0.0), 1, 2).code == 2
    for ran in (CommandResult(0, "", "", 0.0), CommandResult(2, "", "error: it is. It was.", 0.0)):
        with pytest.raises(WrongBehaviorError):
            expect_exit(ran, 2)
