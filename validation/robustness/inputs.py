"""All bad inputs: each a place and a value, how it is tried, and what is told of it."""

from __future__ import annotations

import inspect
import random
import re
import warnings
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import beamdae as bd
from robustness.judge import Seen, complaint, raised
from robustness.places_runs import BASES, NOT_CALLED, NOT_GIVEN
from robustness.values import VALUES
from robustness.workers import Scratch, Silence
from robustness.world import World

# Inputs that are models, files and commands as a whole.
SITUATIONS = ("law", "start", "joint", "curve", "scale", "study of", "file", "command")
# The call without a bad value: it has to run.
WORKING = "nothing bad"
# No input may take longer [s].
LIMIT = 20.0


@dataclass(frozen=True)
class Input:
    """A bad input.

    Attributes
    ----------
    place
        Where it is put.
    value
        What it is.
    attempt
        Does it; what it gives, raises, warns of and prints is judged.
    words
        What a refusal may name, besides what `attempt` adds to it.
    hopeless
        Why no program could do right by it, if that is so.
    """

    place: str
    value: str
    attempt: Callable[[set[str]], Any] = field(repr=False)
    words: tuple[str, ...] = ()
    hopeless: str = ""

    @property
    def name(self) -> str:
        """Place and value."""
        return f"{self.place}: {self.value}"

    @property
    def group(self) -> str:
        """The public name it is about, or the kind of input."""
        begin = re.split(r"[ .\[]", self.place)[0]
        return self.place if self.place in SITUATIONS else begin


def public_name(base: str) -> str:
    """The public name a base is a call of."""
    return re.split(r"[ .]", base)[0]


def uncovered() -> list[str]:
    """Public names without a working call, and arguments no such call gives."""
    missing = []
    for name in bd.__all__:
        calls = [base for key, base in BASES.items() if public_name(key) == name]
        if not calls and name not in NOT_CALLED:
            missing.append(name)
        elif calls and name not in NOT_GIVEN and name not in ("Part", "Integrator"):
            given = {argument for base in calls for argument in base.arguments(World())}
            parameters = inspect.signature(getattr(bd, name)).parameters.values()
            named = {p.name for p in parameters if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)}
            missing += [f"{name}({argument}=)" for argument in sorted(named - given)]
    return missing


def argument_inputs() -> Iterator[Input]:
    """Each value in place of each argument, and of each number in one that is a short listing."""
    for key, base in BASES.items():
        yield Input(key, WORKING, _attempt(key))
        for argument, given in base.arguments(World()).items():
            for place, path in _inside(f"{key}.{argument}", given):
                for value in VALUES:
                    yield Input(
                        place,
                        value,
                        _attempt(key, argument, path, value),
                        (argument, key.split(" ")[0], public_name(key)),
                    )


def _inside(place: str, given: Any) -> Iterator[tuple[str, int | None]]:
    yield place, None
    if isinstance(given, (tuple, list)) and len(given) <= 4:
        yield from ((f"{place}[{k}]", k) for k in range(len(given)))


def _attempt(
    key: str, argument: str = "", index: int | None = None, value: str = ""
) -> Callable[[set[str]], Any]:
    def attempt(words: set[str]) -> Any:
        base, world = BASES[key], World(zlib.crc32(f"{key}.{argument}[{index}]: {value}".encode()))
        arguments = base.arguments(world)
        words |= world.names | {x for x in arguments.values() if isinstance(x, str)}
        if argument:
            bad = VALUES[value](world)
            if index is not None:
                entries = list(arguments[argument])
                entries[index] = bad
                kind = type(arguments[argument])
                bad = getattr(kind, "_make", kind)(entries)
            arguments[argument] = bad
            words |= {str(bad), repr(bad).strip("'")} if isinstance(bad, (str, Path)) else set()
        call = partial(base.call, world) if base.call else getattr(bd, key.partition(" ")[0])
        return base.use(world, call(**arguments))

    return attempt


def all_inputs() -> dict[str, Input]:
    """Every input by name."""
    from robustness.commands import command_inputs
    from robustness.files import file_inputs
    from robustness.situations import situation_inputs

    found = [*argument_inputs(), *situation_inputs(), *file_inputs(), *command_inputs()]
    by_name = {one.name: one for one in found}
    assert len(by_name) == len(found), "two inputs have one name"
    return by_name


def thinned(inputs: dict[str, Input], seed: int) -> list[str]:
    """Each public name with each value at least once, and everything that stands for itself."""
    rng = random.Random(seed)
    kinds: dict[tuple[str, str], list[str]] = {}
    for name, one in inputs.items():
        kinds.setdefault((one.group, one.value), []).append(name)
    return [rng.choice(names) for names in kinds.values()]


def see(one: Input) -> tuple[Seen, str]:
    """Try an input here; what was seen, and why it is not right."""
    words = set(one.words)
    with Scratch("out") as scratch, warnings.catch_warnings(record=True) as told, Silence() as hush:
        warnings.simplefilter("always")
        seen = _tried(one, words)
    told_right = [str(w.message) for w in told if issubclass(w.category, bd.BeamdaeWarning)]
    other = [
        f"{w.category.__name__}: {w.message}" for w in told if str(w.message) not in told_right
    ]
    ended, text = seen.ended, seen.text
    if ended == "ran" and told_right:
        ended, text = "warned", "\n".join(dict.fromkeys(told_right))
    output = "\n".join(filter(None, [seen.output, hush.said.strip(), *other]))
    seen = Seen(ended, text, output, scratch.left)
    if one.value == WORKING and ended not in ("ran", "warned"):
        return seen, "the call without a bad value does not run"
    return seen, complaint(seen, words, exempt=bool(one.words) and one.words[-1] == "own code")


def _tried(one: Input, words: set[str]) -> Seen:
    try:
        return _result(one.attempt(words))
    except bd.BeamdaeError as problem:
        return Seen("refused", str(problem) if type(problem) is bd.BeamdaeError else repr(problem))
    except BaseException as problem:  # Whatever else comes is what is looked for.
        return raised(problem)


def _result(made: Any) -> Seen:
    """How what was made tells that it is no good, or that it is."""
    if isinstance(made, Seen):
        return made
    if not isinstance(made, bd.Solution):
        return Seen("ran")
    made.summary(), made.coordinates(), made.drift
    if not made.status.success:
        return Seen("failed", made.status.sentence)
    if made.warnings:
        return Seen("warned", "\n".join(made.warnings))
    table: pd.DataFrame = made.table()
    broken = [c for c in table if not np.all(np.isfinite(table[c].to_numpy(float)))]
    if broken:
        return Seen("raised", f"ok with columns that are not finite: {', '.join(broken[:5])}")
    return Seen("ran")


_inputs: dict[str, Input] = {}


def see_by_name(name: str) -> tuple[Seen, str]:
    """Try an input in a process that was sent its name alone."""
    if not _inputs:
        _inputs.update(all_inputs())
    return see(_inputs[name])
