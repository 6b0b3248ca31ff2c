"""Messages of the library with the options of a command in place of Python arguments."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from inspect import signature
from typing import Any

from beamdae.deferred import public

# Arguments whose options have other names.
_RENAMED_ARGUMENTS = {
    "between": "over",
    "experiments": "experiment",
    "loads": "load",
    "n": "number",
    "parameters": "settings",
}
# An argument such as "period=", "about='equilibrium'", "bounds={...}", "offset=['tip.y']",
# "switch=[1, 1]", "damping=False" or "output_step=1e-3".
_ARGUMENT = re.compile(
    r"(?<![\w.-])(?P<name>[a-z]\w*)="
    r"(?P<value>'[^']*'|\{[^}]*\}|\[[^]]*\]|True\b|False\b|[\d.e+-]*\d(?![\w=])"
    r"|(?=[\s,;.)]|$))"
)
_PAIR = re.compile(r"\{'([^']*)': '([^']*)'\}")  # of a name and a text
# The function that rejects an argument, at the start of a message, and the argument, as in
# "simulate: t_end must". Arguments of parts, such as the formulation of a beam, are no options.
_CALL = re.compile(
    r"(?P<call>(?:error: )?(?P<function>simulate|equilibrium|buckling|modes|linearize|bode|campbell"
    r"|periodic|frequency_response|fit|optimize|export_fmu|sweep|compare|Auto|Ida|Radau"
    r"|GeneralizedAlpha): )(?:(?P<name>[a-z]\w*)(?= must ))?"
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

    Arguments without "=" are replaced if the message begins with the call that rejects them.
    Arguments of this call that are no options of the command become code. Code, such as
    bd.Mechanism(start="equilibrium"), and arguments of parts are left unchanged.
    """
    options = _current_options.get()
    if not options or _MODEL_ERROR.search(sentence):
        return sentence
    call = _CALL.match(sentence)

    def replace(match: re.Match[str]) -> str:
        option, value = options.get(match["name"]), match["value"]
        # Flags without a value, such as "damping=", belong to parts.
        is_flag = option is not None and option.is_flag and not value
        if is_flag or _CODE.search(sentence[: match.start()]):
            return match[0]
        if option is None:
            if not call or match["name"] not in signature(public(call["function"])).parameters:
                return match[0]
            return f"bd.{call['function']}({match[0]}{'' if value else '...'})"
        name = _long_name(option)
        if value == "False":
            return option.secondary_opts[0] if option.secondary_opts else match[0]
        if value.startswith("{"):
            pair = _PAIR.fullmatch(value)
            return f'{name} "{pair[1]}={pair[2]}"' if pair else f"{name} {option.metavar}"
        text = re.sub(r"[\[\]']", "", value.removeprefix("True"))
        if value.startswith("["):  # Names are separated by commas; numbers repeat the option.
            separator = "," if "'" in value else f" {name} "
            return f"{name} {text.replace(', ', separator)}"
        return f'{name} "{text}"' if " " in text else f"{name} {text}".rstrip()

    if call and call["name"] in options:
        sentence = call["call"] + _long_name(options[call["name"]]) + sentence[call.end() :]
    return _ARGUMENT.sub(replace, sentence)


def _long_name(option: Any) -> str:
    """Return the first name of an option in the help that is no single letter."""
    return next(name for name in option.opts if name.startswith("--"))
