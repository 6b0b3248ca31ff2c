"""Robustness: accepted and rejected outcomes, coverage, isolation, faults of the machine."""

import numpy as np
import pytest
from isolated_trials import run_trial
from mechanisms import rectangle
from robustness import faults, mechanisms
from robustness.inputs import catalog
from robustness.inputs.bad_input import MODEL_GROUPS
from robustness.isolation import ProcessPool
from robustness.judge import (
    MAX_SENTENCE_LENGTH,
    TrialOutcome,
    check_sentence,
    find_complaint,
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


@pytest.mark.slow(reason="starts worker processes")
def test_process_that_dies_or_hangs_is_replaced():
    names = ["first", "dies", "hangs", "exits", "last"]
    with ProcessPool(1) as processes:
        results = dict(processes.run_trials(run_trial, names, 0.5))
    assert results == {"first": "first", "dies": None, "hangs": ..., "exits": None, "last": "last"}


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
    right = {"ended": "ok", "error": 50.0, "imbalance": 1e-3}
    message = mechanisms.find_run_complaint(mechanisms.Run(**{**right, **row}))
    assert complaint in message
    assert bool(message) == bool(complaint)


@pytest.mark.slow(reason="half a second and more")
def test_every_public_name_and_argument_has_a_working_call():
    assert catalog.list_uncovered_names() == []


@pytest.mark.slow(reason="collects all inputs")
def test_no_group_of_inputs_is_missing_from_the_sample():
    inputs = catalog.collect_inputs()
    groups = {inputs[name].group for name in catalog.sample_inputs(inputs, seed=1)}
    assert groups == {*map(catalog.public_name_of, catalog.WORKING_CALLS), *MODEL_GROUPS}


@pytest.mark.slow(reason="real commands")
@pytest.mark.parametrize("name", faults.list_names())
def test_faults_have_the_right_outcome(name):
    (complaint,) = faults.try_name(name)
    if complaint is None:
        pytest.skip("not permitted on this machine")
    assert not complaint, f"{complaint}; right: {faults.FAULTS[name].__doc__}"


SECTION = rectangle(0.01, 1.0, material=bd.Material(E=1e7, nu=0.3, rho=1e3))


def roll_up_half(bodies, frame):
    """Return the tip of a clamped strip of 1 m under the moment of a half circle."""
    mech = bd.Mechanism()
    axis = bd.Line((0.0, 0.0), (1.0, 0.0))
    elements = max(8 // bodies, 2)
    settings = {"elements": elements, "frame": frame, "strain": "green"}
    beams = bd.welded_beams(mech, "beam", axis, SECTION, bodies, **settings)
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beams[0].start))
    mech.add(bd.Moment("moment", beams[-1].end, np.pi * SECTION.EI))
    mech.observe("tip", beams[-1].end)
    path = bd.equilibrium(mech)
    assert path.status.success, path.status.sentence
    return [path.columns[f"tip.{name} [m]"][-1] for name in "xy"]


@pytest.mark.slow(reason="equilibria of six cantilevers")
@pytest.mark.parametrize(
    ("frame", "numbers", "order", "at_eight"),
    # Two tangent frames have a limit point at two thirds of the moment.
    [("chord", (2, 4, 8), 4.0, 3e-5), ("tangent", (4, 8, 16), 3.0, 2e-3)],
)
def test_error_of_half_a_roll_up_falls_at_the_stated_order(frame, numbers, order, at_eight):
    # A moment alone bends Reissner's strip to a circle.
    exact = np.array([0.0, 2.0 / np.pi])
    tips = [roll_up_half(bodies, frame) for bodies in numbers]
    errors = np.linalg.norm(tips - exact, axis=1) / np.linalg.norm(exact - [1.0, 0.0])
    assert np.all(-np.diff(np.log2(errors)) > order)
    assert errors[numbers.index(8)] < at_eight
