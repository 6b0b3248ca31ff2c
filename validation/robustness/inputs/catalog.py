"""Catalog of all bad inputs: every value in place of every argument, bad models and commands."""

import inspect
import random
import re
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

from robustness.inputs import analysis_calls, model_calls, run_calls
from robustness.inputs.bad_input import BAD_VALUES, NO_BAD_VALUE, BadInput, try_input
from robustness.inputs.command_line import command_inputs, file_inputs
from robustness.inputs.sandbox import Sandbox, WorkingCall
from robustness.inputs.situations import situation_inputs
from robustness.isolation import draw_sample
from robustness.judge import escape_unprintable

import beamdae as bd
from beamdae import catalog

WORKING_CALLS: dict[str, WorkingCall] = {
    key: call
    for calls in (
        model_calls.PART_CALLS,
        model_calls.VARIANT_CALLS,
        model_calls.NUMBER_CALLS,
        model_calls.MECHANISM_CALLS,
        model_calls.SYSTEM_CALLS,
        run_calls.MODEL_CALLS,
        run_calls.INTEGRATOR_CALLS,
        run_calls.STUDY_CALLS,
        run_calls.SOLUTION_CALLS,
        analysis_calls.STATIC_CALLS,
        analysis_calls.SECTION_FORCE_CALLS,
        analysis_calls.PERIODIC_CALLS,
        analysis_calls.MODE_CALLS,
        run_calls.SWEEP_CALLS,
        analysis_calls.REFINEMENT_CALLS,
        analysis_calls.SENSITIVITY_CALLS,
        analysis_calls.EXPORT_CALLS,
        run_calls.CONTROL_CALLS,
    )
    for key, call in calls.items()
}

# Public names without a working call: exceptions, warnings and a base class. Bad values replace
# results where these are arguments of other calls.
NOT_CALLABLE = frozenset({"BeamdaeError", "BeamdaeWarning", "Interrupted", "Joint"})
# Base classes for users; the arguments of their calls are members that a subclass overrides.
USER_BASE_CLASSES = frozenset({"Integrator", "Part"})
_MAX_CELL_LENGTH = 200  # characters
_MAX_REPLACED_ENTRIES = 4  # bad values replace each entry of tuples and lists up to this length


def public_name_of(key: str) -> str:
    """Return the public name that a working call with this key tests."""
    return re.split(r"[ .]", key)[0]


def list_uncovered_names() -> list[str]:
    """Return public names without a working call, and arguments that no such call passes.

    Classes of results may have calls of their methods alone.
    """
    missing = []
    for name, public in catalog.NAMES.items():
        calls = {key: call for key, call in WORKING_CALLS.items() if public_name_of(key) == name}
        is_called = any(key.split(" ")[0] == name for key in calls)
        if not is_called and public.path.startswith("results."):
            continue
        if not calls and name not in NOT_CALLABLE:
            missing.append(name)
        elif calls and name not in USER_BASE_CLASSES:
            passed = {x for call in calls.values() for x in call.arguments(Sandbox())}
            parameters = inspect.signature(attrgetter(public.path)(bd)).parameters.values()
            named = {p.name for p in parameters if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)}
            missing += [f"{name}({argument}=)" for argument in sorted(named - passed)]
    return missing


def argument_inputs() -> Iterator[BadInput]:
    """Yield each working call, and each bad value in place of each argument and entry of it."""
    for key, call in WORKING_CALLS.items():
        yield BadInput(key, NO_BAD_VALUE, _make_attempt(key))
        for argument, good in call.arguments(Sandbox()).items():
            for place, index in _list_places(f"{key}.{argument}", good):
                for value in BAD_VALUES:
                    yield BadInput(
                        place,
                        value,
                        _make_attempt(key, argument, index, value),
                        (argument, key.split(" ")[0], public_name_of(key)),
                    )


def _list_places(place: str, good: Any) -> Iterator[tuple[str, int | None]]:
    yield place, None
    if isinstance(good, (tuple, list)) and len(good) <= _MAX_REPLACED_ENTRIES:
        yield from ((f"{place}[{k}]", k) for k in range(len(good)))


def _make_attempt(
    key: str, argument: str = "", index: int | None = None, value: str = ""
) -> Callable[[set[str]], Any]:
    """Return a function that makes the working call `key` with the bad value in its place."""

    def attempt(words: set[str]) -> Any:
        call = WORKING_CALLS[key]
        sandbox = Sandbox(zlib.crc32(f"{key}.{argument}[{index}]: {value}".encode()))
        arguments = call.arguments(sandbox)
        words |= sandbox.names | {x for x in arguments.values() if isinstance(x, str)}
        if argument:
            bad = BAD_VALUES[value](sandbox)
            if index is not None:
                entries = list(arguments[argument])
                entries[index] = bad
                kind = type(arguments[argument])
                # Named tuples are created from a list by _make.
                bad = getattr(kind, "_make", kind)(entries)
            arguments[argument] = bad
            if isinstance(bad, str):
                # The methods of a subclass of str may raise.
                text = str.__str__(bad)
                words |= {text, repr(text).strip("'")}
            words |= {str(bad)} if isinstance(bad, Path) else set()
        return call.make(key, sandbox, arguments)

    return attempt


def collect_inputs() -> dict[str, BadInput]:
    """Return every input by name."""
    inputs = [*argument_inputs(), *situation_inputs(), *file_inputs(), *command_inputs()]
    by_name = {bad_input.name: bad_input for bad_input in inputs}
    assert len(by_name) == len(inputs), "two inputs have one name"
    return by_name


def sample_inputs(inputs: dict[str, BadInput], seed: int) -> list[str]:
    """Return names of a sample with each value of each group at least once."""
    rng = random.Random(seed)
    names_by_kind: dict[tuple[str, str], list[str]] = {}
    for name, bad_input in inputs.items():
        names_by_kind.setdefault((bad_input.group, bad_input.value), []).append(name)
    return [rng.choice(names) for names in names_by_kind.values()]


@cache
def _inputs_by_name() -> dict[str, BadInput]:
    return collect_inputs()


def list_names() -> list[str]:
    """Return the names of all inputs to which a program can respond."""
    return [name for name, bad_input in _inputs_by_name().items() if not bad_input.hopeless]


def draw_names(size: int, seed: int) -> list[str]:
    """Return names of a sample, with each value of each group if it is large enough."""
    inputs = _inputs_by_name()
    names = draw_sample(sample_inputs(inputs, seed), size, seed)
    return [name for name in names if not inputs[name].hopeless]


def try_name(name: str) -> list[str]:
    """Try an input in a worker process, to which only names can be sent; return the complaint."""
    outcome, complaint = try_input(_inputs_by_name()[name])
    seen = escape_unprintable(f"{outcome.text} {outcome.output}".strip()[:_MAX_CELL_LENGTH])
    return [f"{complaint}: {seen}" if complaint else ""]
