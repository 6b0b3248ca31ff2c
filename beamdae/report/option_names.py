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
# An argument such as "period=", "about='equilibrium'", "bounds={...}", "offset=['tip.y']",
# "damping=False" or "output_step=1e-3".
_ARGUMENT = re.compile(
    r"(?<![\w.-])(?P<name>[a-z]\w*)="
    r"(?P<value>'[^']*'|\{[^}]*\}|\['[^]]*'\]|True\b|False\b|[\d.e+-]*\d(?![\w=])"
    r"|(?=[\s,;.)]|$))"
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
# Values of options, such as "--set step=", arguments in an unfinished call, such as
# "bd.Mechanism(", and exceptions of a model file are left unchanged.
_CODE = re.compile(r"--[\w-]+ $|\w\([^()]*$")
_MODEL_ERROR = re.compile(r"(?:the model function in .*|: the import|: the constructor) failed: ")

_current_options: ContextVar[Mapping[str, Any]] = ContextVar("current_options", default={})  # noqa: B039


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


def form_of_option(option: str) -> str:
    """Return the form of the values of an option of the command, such as "NAME=VALUE"."""
    options = _current_options.get().values()
    return next((x.metavar for x in options if option in x.opts), "NAME=VALUE")


def name_options(sentence: str) -> str:
    """Replace Python arguments, such as "t_end=", by options of the command, such as "--t-end".

    Arguments without "=" are replaced if the message begins with the call that rejects them. Code,
    such as bd.Mechanism(start="equilibrium"), and arguments of parts are left unchanged.
    """
    options = _current_options.get()
    if not options or _MODEL_ERROR.search(sentence):
        return sentence

    def replace(match: re.Match[str]) -> str:
        option, value = options.get(match["name"]), match["value"]
        # Flags without a value, such as "damping=", belong to parts.
        is_code = option is None or _CODE.search(sentence[: match.start()])
        if option is None or is_code or (option.is_flag and not value):
            return match[0]
        name = _long_name(option)
        if value == "False":
            return option.secondary_opts[0] if option.secondary_opts else match[0]
        if value.startswith("{"):
            pair = _PAIR.fullmatch(value)
            return f'{name} "{pair[1]}={pair[2]}"' if pair else f"{name} {option.metavar}"
        text = re.sub(r"[\[\]']", "", value.removeprefix("True"))
        text = text.replace(", ", ",") if value.startswith("[") else text
        return f'{name} "{text}"' if " " in text else f"{name} {text}".rstrip()

    checked = _CHECKED_ARGUMENT.match(sentence)
    if checked and checked["name"] in options:
        name = _long_name(options[checked["name"]])
        sentence = checked["call"] + name + sentence[checked.end() :]
    return _ARGUMENT.sub(replace, sentence)


def _long_name(option: Any) -> str:
    """Return the first name of an option in the help that is no single letter."""
    return next(name for name in option.opts if name.startswith("--"))
