"""A bad input, and its trial in this process."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import beamdae as bd
from robustness.isolation import OutputCapture, ScratchFolder
from robustness.judge import TrialOutcome, find_complaint, outcome_of_exception

# Inputs that are whole models, files or commands.
MODEL_GROUPS = ("law", "start", "joint", "curve", "scale", "study of", "file", "command")
NO_BAD_VALUE = "nothing bad"  # value of a working call, which has to run


@dataclass(frozen=True)
class BadInput:
    """A bad input.

    Attributes
    ----------
    place
        Argument, model, file or command that gets the value.
    value
        Description of the value.
    attempt
        Function that tries the input. Its result, exception, warnings and output are judged; it
        adds names that a refusal may contain to its argument.
    words
        Names that a refusal may contain.
    hopeless
        Reason why no program could respond correctly, if there is one.
    exempt
        The input is the user's own code, which may print and whose exceptions may be quoted.
    """

    place: str
    value: str
    attempt: Callable[[set[str]], Any] = field(repr=False)
    words: tuple[str, ...] = ()
    hopeless: str = ""
    exempt: bool = False

    @property
    def name(self) -> str:
        """Place and value."""
        return f"{self.place}: {self.value}"

    @property
    def group(self) -> str:
        """Public name that the input tests, or its kind for models, files and commands."""
        first_word = re.split(r"[ .\[]", self.place)[0]
        return self.place if self.place in MODEL_GROUPS else first_word


def try_input(bad_input: BadInput) -> tuple[TrialOutcome, str]:
    """Try an input in this process; return its outcome and the complaint about it."""
    words = set(bad_input.words)
    with (
        ScratchFolder("out") as scratch,
        warnings.catch_warnings(record=True) as caught,
        OutputCapture() as captured,
    ):
        warnings.simplefilter("always")
        outcome = _run_attempt(bad_input, words)
    expected, unexpected = [], []
    for warning in caught:
        if issubclass(warning.category, bd.BeamdaeWarning):
            expected.append(str(warning.message))
        else:
            unexpected.append(f"{warning.category.__name__}: {warning.message}")
    ended, text = outcome.ended, outcome.text
    if ended == "ran" and expected:
        ended, text = "warned", "\n".join(dict.fromkeys(expected))
    output = "\n".join(filter(None, [outcome.output, captured.text.strip(), *unexpected]))
    outcome = TrialOutcome(ended, text, output, scratch.remaining)
    if bad_input.value == NO_BAD_VALUE and ended not in ("ran", "warned"):
        return outcome, "the call without a bad value does not run"
    return outcome, find_complaint(outcome, words, bad_input.exempt)


def _run_attempt(bad_input: BadInput, words: set[str]) -> TrialOutcome:
    try:
        return _assess_result(bad_input.attempt(words))
    except bd.BeamdaeError as error:
        # Subclasses, such as that of damaged files, have the same sentence.
        return TrialOutcome("refused", str(error))
    except BaseException as error:  # SystemExit and KeyboardInterrupt are wrong outcomes, too.
        return outcome_of_exception(error)


def _assess_result(result: Any) -> TrialOutcome:
    """Return the outcome of a result: that of a solution by its status, warnings and columns."""
    if isinstance(result, TrialOutcome):
        return result
    if not isinstance(result, bd.results.Solution):
        return TrialOutcome("ran")
    result.summary(), result.coordinates(), result.drift
    if not result.status.success:
        return TrialOutcome("failed", result.status.sentence)
    if result.warnings:
        return TrialOutcome("warned", "\n".join(result.warnings))
    table = result.table()
    broken = [c for c in table if not np.all(np.isfinite(table[c].to_numpy(float)))]
    if broken:
        text = f"ok with columns that are not finite: {', '.join(broken[:5])}"
        return TrialOutcome("raised", text)
    return TrialOutcome("ran")
