"""A bad input, its trial in this process, and values that most arguments reject."""

import math
import re
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from robustness.isolation import OutputCapture, ScratchFolder
from robustness.judge import TrialOutcome, find_complaint, outcome_of_exception

import beamdae as bd

# Inputs that are whole models, files or commands.
MODEL_GROUPS = ("law", "start", "joint", "curve", "scale", "study of", "file", "command")
NO_BAD_VALUE = "nothing bad"  # value of a working call, which has to run


def _nested(depth: int) -> list[Any]:
    value: list[Any] = []
    for _ in range(depth):
        value = [value]
    return value


def _raise(*arguments: Any, **options: Any) -> Any:
    raise RuntimeError("this object raises")


_METHODS_OF_OBJECTS = ("bool", "eq", "hash", "len", "repr", "str")

_METHODS_OF_NUMBERS = ("abs", "add", "float", "ge", "gt", "index", "int", "le", "lt", "mul", "neg")


_METHODS_OF_CONTAINERS = ("contains", "getitem", "iter", "reversed")


def _hostile(base: type, names: Iterable[str], *arguments: Any, **members: Any) -> Any:
    """Return an object of a subclass of `base` whose special methods raise."""
    members |= {f"__{name}__": _raise for name in names}
    return type("Hostile", (base,), members)(*arguments)


HOSTILE_VALUES: dict[str, Callable[[Any], Any]] = {
    "object whose methods raise": lambda box: _hostile(
        object, (*_METHODS_OF_OBJECTS, *_METHODS_OF_NUMBERS, *_METHODS_OF_CONTAINERS)
    ),
    "object whose attributes raise": lambda box: _hostile(object, ("getattr",)),
    "number that raises": lambda box: _hostile(
        float, (*_METHODS_OF_OBJECTS, *_METHODS_OF_NUMBERS), 1.0
    ),
    "list that raises": lambda box: _hostile(
        list, (*_METHODS_OF_OBJECTS, *_METHODS_OF_CONTAINERS), [1.0, 2.0]
    ),
    "dictionary that raises": lambda box: _hostile(
        dict, (*_METHODS_OF_OBJECTS, *_METHODS_OF_CONTAINERS), {"a": 1.0}, items=_raise
    ),
    "text that raises": lambda box: _hostile(
        str, (*_METHODS_OF_OBJECTS, *_METHODS_OF_CONTAINERS), "abc", strip=_raise
    ),
    "path that raises": lambda box: _hostile(object, ("fspath", "str")),
    "array that raises": lambda box: _hostile(object, ("array",), ndim=0, item=_raise),
    # Without a valid name, it is no model function, whose exceptions are passed on unchanged.
    "function whose error has no text": lambda box: lambda *t, **options: _raise_hostile(),
}


def _raise_hostile(*arguments: Any, **options: Any) -> Any:
    raise type("HostileError", (Exception,), {"__str__": _raise, "__repr__": _raise})()


# Functions of the sandbox, so that each trial gets a new value.
BAD_VALUES: dict[str, Callable[[Any], Any]] = {
    "nan": lambda box: math.nan,
    "inf": lambda box: math.inf,
    "-inf": lambda box: -math.inf,
    "-1": lambda box: -1,
    "0": lambda box: 0,
    "-0.0": lambda box: -0.0,
    "10**400": lambda box: 10**400,
    "1e308": lambda box: 1e308,
    "-1e308": lambda box: -1e308,
    "1e-308": lambda box: 1e-308,
    "5e-324": lambda box: 5e-324,
    "1e12": lambda box: 1e12,
    "1e-12": lambda box: 1e-12,
    "True": lambda box: True,
    "None": lambda box: None,
    "empty text": lambda box: "",
    "text": lambda box: "abc",
    "text of a number": lambda box: "1.0",
    "bytes": lambda box: b"x",
    "empty list": lambda box: [],
    "empty dictionary": lambda box: {},
    "empty set": lambda box: set(),
    "tuple of one": lambda box: (1,),
    "tuple of three": lambda box: (1, 2, 3),
    "pair with nan": lambda box: (1.0, math.nan),
    "pair of texts": lambda box: ("a", "b"),
    "object": lambda box: object(),
    "function of nothing": lambda box: lambda: None,
    "function that gives None": lambda box: lambda *t: None,
    "function that fails": lambda box: lambda *t: 1 / 0,
    "complex": lambda box: 1 + 2j,
    "nested lists": lambda box: [[1, [2]], [3]],
    "ragged list": lambda box: [[1, 2], [3]],
    "list in a thousand lists": lambda box: _nested(1000),
    "array of two": lambda box: np.array([1.0, 2.0]),
    "array of shape (3, 3)": lambda box: np.ones((3, 3)),
    "array of shape (0,)": lambda box: np.zeros(0),
    "array without a dimension": lambda box: np.array(1.0),
    "array of nan": lambda box: np.full(2, np.nan),
    "array of texts": lambda box: np.array(["a", "b"]),
    "array of objects": lambda box: np.array([None, {}], object),
    "numpy integer": lambda box: np.int8(-1),
    "numpy nan": lambda box: np.float32("nan"),
    "SX symbol": lambda box: ca.SX.sym("s"),
    "MX symbol": lambda box: ca.MX.sym("m"),
    "SX vector": lambda box: ca.SX.sym("s", 3),
    "DM": lambda box: ca.DM([1.0, math.nan]),
    "long text": lambda box: "x" * 100_000,
    "control characters": lambda box: "a\x1b[31m\r\n\tb\x00",
    "markup": lambda box: "[bold]a[/bold] <b>&amp;</b>",
    "half a surrogate": lambda box: "\ud800",
    "separators": lambda box: "../a/b\\c",
    "generator": lambda box: (x for x in (1.0, 2.0)),
    "range": lambda box: range(2),
    "Decimal nan": lambda box: Decimal("nan"),
    "Fraction": lambda box: Fraction(10**400, 3),
    "path": lambda box: Path("nowhere"),
    "another part": lambda box: box.bar,
    "a part of another mechanism": lambda box: bd.RigidBody("stranger", 1.0, 1.0),
    "an attachment": lambda box: box.bar.at(1.0, 0.0),
    "a mechanism": lambda box: box.mech,
    "a class": lambda box: int,
    "a module": lambda box: np,
    "Ellipsis": lambda box: ...,
} | HOSTILE_VALUES


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
