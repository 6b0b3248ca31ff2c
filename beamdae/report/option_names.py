"""Messages of the library with the options of a command in place of Python arguments."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

# Arguments whose options have other names.
_RENAMED_ARGUMENTS = {
    "between": "over",
    "experiments": "experiment",
    "loads": "load",
    "n": "number",
    "parameters": "settings",
}
# Expressions of Python that have another form on the command line, or none, by an option that only
# commands with this form have.
_EXPRESSIONS = {
    "minimize": (
        (
            r"Frequency\(number, about='equilibrium'\)|(?<!, )about='equilibrium'",
            "frequency:NUMBER:equilibrium",
        ),
        (r"GeneralizedAlpha\(step=([^()]+)\)", r"--step \1"),
    ),
    "output_step": ((r"output_step=([\d.e+-]+\d)", r"--output-step \1"),),
}
# An argument such as "period=", "about='equilibrium'", "bounds={...}", "offset=['tip.y']" or
# "damping=False".
_ARGUMENT = re.compile(
    r"(?<![\w.-])(?P<name>[a-z]\w*)="
    r"(?P<value>'[^']*'|\"[^\"]*\"|\{[^}]*\}|\['[^]]*'\]|True\b|False\b|(?=[\s,;.)]|$))"
)
_PAIR = re.compile(r"\{'([^']*)': '([^']*)'\}")  # of a name and a text
# An argument of a function that a command calls, at the start of a message: "simulate: t_end must".
# Arguments of parts, such as the formulation of a beam, are no options.
_CHECKED_ARGUMENT = re.compile(
    r"(?P<call>(?:error: )?(?:simulate|equilibrium|buckling|modes|linearize|bode|campbell|periodic"
    r"|frequency_response|fit|optimize|export_fmu|sweep|compare|Auto|Ida|Radau|GeneralizedAlpha): )"
    r"(?P<name>[a-z]\w*)(?= must )"
)
# Options of pictures, which are no arguments of the analysis, but of parts, such as tables.
_PICTURE_OPTIONS = {"x"}
# An unfinished call, such as "bd.Mechanism(", whose arguments stay Python code.
_OPEN_CALL = re.compile(r"\w\([^()]*$")
# Values of options, such as "--set step=", and exceptions of a model file are left unchanged.
_OPTION = re.compile(r"--[\w-]+ $")
_MODEL_ERROR = re.compile(r"(?:the model function in .*|: the import|: the constructor) failed: ")

_current_options: ContextVar[Mapping[str, Any]] = ContextVar("current_options", default={})  # noqa: B039


def _beam_formulations() -> tuple[str, ...]:
    from beamdae.beams.beam import FORMULATIONS  # takes longer to import than help is displayed

    return FORMULATIONS


@contextmanager
def use_options(parameters: Iterable[Any]) -> Iterator[None]:
    """Name the options among these parameters of a command in messages within a `with` block."""
    options = {
        x.name: x
        for x in parameters
        if x.opts[0].startswith("-") and x.name not in _PICTURE_OPTIONS
    }
    for argument, name in _RENAMED_ARGUMENTS.items():
        if name in options:
            options.setdefault(argument, options[name])
    token = _current_options.set(options)
    try:
        yield
    finally:
        _current_options.reset(token)


def name_options(sentence: str) -> str:
    """Replace Python arguments, such as "t_end=", by options of the command, such as "--t-end".

    Arguments without "=" are replaced if the message begins with the call that rejects them. Code,
    such as bd.Mechanism(start="equilibrium"), and arguments of parts are left unchanged.
    """
    options = _current_options.get()
    if not options or _MODEL_ERROR.search(sentence):
        return sentence

    def replace(match: re.Match[str]) -> str:
        option = options.get(match["name"])
        before = sentence[: match.start()]
        if option is None or _OPTION.search(before) or _OPEN_CALL.search(before):
            return match[0]
        name, value = _long_name(option), match["value"]
        # Flags without a value, such as "damping=", and formulations of beams belong to parts.
        is_of_part = option.is_flag if not value else option.name == "formulation"
        if is_of_part and value[1:-1] in ("", *_beam_formulations()):
            return match[0]
        if value == "False":
            return option.secondary_opts[0] if option.secondary_opts else match[0]
        if pair := _PAIR.fullmatch(value):
            return f'{name} "{pair[1]}={pair[2]}"'
        if value.startswith("{"):
            return f"{name} {option.metavar}"
        if value in ("", "True"):
            return name
        text = value[1:-1]
        if value.startswith("["):
            text = text.replace("'", "").replace(", ", ",")
        return f'{name} "{text}"' if " " in text else f"{name} {text}"

    for option, expressions in _EXPRESSIONS.items():
        for pattern, form in expressions if option in options else ():
            sentence = re.sub(pattern, form, sentence)
    checked = _CHECKED_ARGUMENT.match(sentence)
    if checked and checked["name"] in options:
        name = _long_name(options[checked["name"]])
        sentence = checked["call"] + name + sentence[checked.end() :]
    return _ARGUMENT.sub(replace, sentence)


def _long_name(option: Any) -> str:
    """Return the first name of an option in the help that is no single letter."""
    return next(name for name in option.opts if name.startswith("--"))
