"""The program of validation/robustness itself: what it takes for right, and what not."""

import os
import sys
import warnings

import numpy as np
import pytest
from robustness import inputs, mechanisms
from robustness.bench import NotRightError, Ran, told
from robustness.inputs import Input, see
from robustness.judge import LONGEST, Seen, command_seen, complaint, not_a_sentence
from robustness.workers import Processes
from robustness_trials import trial

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
def test_a_sentence_is_right(sentence):
    assert not_a_sentence(sentence) == ""
    assert complaint(Seen("refused", sentence)) == ""


@pytest.mark.parametrize(
    ("sentence", "why"),
    [
        ("beam: it is wrong. Take another.", "two sentences"),
        ("beam: it is wrong", "period"),
        ("beam: it must be a number, got <object object at 0x7fb2bb26e190>.", "address"),
        ("beam: it failed: .../casadi/core/sx_elem.cpp:166: no truth value.", "another library"),
        ("beam: it failed: setting an array element with a sequence.", "another library"),
        ("beam: it failed: maximum recursion depth exceeded.", "another library"),
        (f"beam: it must be a number, got '{'x' * LONGEST}'.", "characters"),
        ("beam\x1b[31m: it is wrong.", "control characters"),
    ],
)
def test_what_is_no_sentence_is_not_right(sentence, why):
    assert why in complaint(Seen("refused", sentence))


@pytest.mark.parametrize(
    ("seen", "why"),
    [
        (Seen("crashed"), "crashed"),
        (Seen("hung"), "hung"),
        (Seen("raised", "TypeError: 'int' object is not iterable"), "raised"),
        (Seen("refused", f"{RIGHT}\n{RIGHT}"), "2 lines"),
        (Seen("refused", ""), "0 lines"),
        (Seen("failed", ""), "no reason"),
        (Seen("ran", output="RuntimeWarning: overflow"), "output beside"),
        (Seen("ran", files=("core",)), "files are left"),
    ],
)
def test_other_ends_are_not_right(seen, why):
    assert why in complaint(seen)


def test_a_refusal_names_what_it_is_about():
    assert complaint(Seen("refused", RIGHT), ["beam"]) == ""
    assert "names neither" in complaint(Seen("refused", RIGHT), ["element", "bea"])


def test_a_command_is_judged_by_its_exit_code_and_standard_error():
    assert command_seen(0, "table", "") == Seen("ran")
    assert command_seen(2, "", f"error: {RIGHT}\n") == Seen("refused", RIGHT)
    assert command_seen(1, "table", "failed: time limit of 2 s\n") == Seen(
        "failed", "time limit of 2 s"
    )
    assert command_seen(1, "", "Traceback (most recent call last):\nE: x\n").ended == "raised"
    assert command_seen(-11, "", "").ended == "crashed"
    assert "output beside" in complaint(command_seen(2, "half a table", f"error: {RIGHT}"))
    box = "Usage: beamdae run\nTry 'beamdae --help'\n╭─ Error ─╮\n│ No such │\n│ option │\n╰───╯\n"
    assert command_seen(2, "", box) == Seen("refused", "No such option.")


@pytest.mark.slow(reason="processes of its own")
def test_a_process_that_dies_or_hangs_is_named_and_others_go_on():
    names = ["first", "dies", "hangs", "leaves", "last"]
    with Processes(1) as processes:
        found = dict(processes.tried(trial, names, 0.5))
    assert found == {"first": "first", "dies": None, "hangs": ..., "leaves": None, "last": "last"}


def _seen(attempt, **settings):
    return see(Input("place", "value", attempt, **settings))


def test_what_an_attempt_prints_warns_and_leaves_is_seen():
    def loud(words):
        os.write(2, b"from below\n")
        sys.stdout.write("from above\n")
        warnings.warn("of numpy", RuntimeWarning, stacklevel=1)
        with open("left.txt", "w"):
            pass

    seen, why = _seen(loud)
    assert seen.output.splitlines() == ["from below", "from above", "RuntimeWarning: of numpy"]
    assert seen.files == ("left.txt",)
    assert "output beside" in why


def test_an_attempt_is_refused_by_a_sentence_alone():
    def refused(words):
        words.add("beam")
        raise bd.BeamdaeError(RIGHT)

    assert _seen(refused) == (Seen("refused", RIGHT), "")
    assert "raised ZeroDivisionError" in _seen(lambda words: 1 / 0)[1]
    assert "raised SystemExit" in _seen(lambda words: exit(0))[1]


def test_every_public_name_is_tried(monkeypatch):
    assert inputs.uncovered() == []
    monkeypatch.setattr(bd, "__all__", ["Weld", "Lever", "Arc"])
    assert inputs.uncovered() == ["Lever"]
    monkeypatch.delitem(inputs.BASES, "Weld")
    monkeypatch.setattr(bd, "Arc", lambda radius, length, start, angle, turns: None)
    assert inputs.uncovered() == ["Weld", "Lever", "Arc(turns=)"]


def test_the_thinned_sample_has_each_public_name_with_each_value(monkeypatch):
    few = {name: inputs.VALUES[name] for name in ("nan", "None", "object")}
    monkeypatch.setattr(inputs, "VALUES", few)
    known = {one.name: one for one in inputs.argument_inputs()}
    sample = inputs.thinned(known, seed=3)
    kinds = {(known[name].group, known[name].value) for name in sample}
    assert kinds == {(one.group, one.value) for one in known.values()}
    assert len(sample) == len(kinds)
    assert inputs.thinned(known, seed=3) == sample
    assert inputs.thinned(known, seed=4) != sample


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (("ok", "", 1e-3, 50.0, ""), ""),
        (("ok", "", 0.2, 50.0, ""), "energies do not close"),
        (("ok", "", np.nan, 50.0, ""), "energies do not close"),
        (("ok", "", 0.2, 50.0, "beam: it bends far."), ""),
        (("ok", "", 1e-3, 101.0, ""), "from the other methods"),
        (("ok", "", 1e-3, 101.0, "tip: the estimated error is 0.1."), ""),
        (("failed", "the residual is not finite", np.nan, np.nan, ""), ""),
        (("failed", "", 1e-3, 1.0, ""), "it ended failed"),
        (("interrupted", "by the user", 1e-3, 1.0, ""), "it ended interrupted"),
    ],
)
def test_a_mechanism_closes_its_books_and_agrees_or_tells(line, why):
    assert why in mechanisms.complaint(*line)
    assert bool(mechanisms.complaint(*line)) == bool(why)


def test_a_fault_is_right_by_exit_code_and_sentence():
    assert told(Ran(2, "", f"error: {RIGHT}", 0.0), 1, 2).code == 2
    for ran in (Ran(0, "", "", 0.0), Ran(2, "", "error: it is. It was.", 0.0)):
        with pytest.raises(NotRightError):
            told(ran, 2)
