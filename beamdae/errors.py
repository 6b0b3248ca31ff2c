"""Exceptions and warnings of beamdae, and the argument checks that raise them."""

from __future__ import annotations

import difflib
import inspect
import math
import os
import re
import sys
import sysconfig
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from decimal import Decimal
from functools import lru_cache, wraps
from itertools import islice
from numbers import Real
from pathlib import Path
from types import TracebackType
from typing import Any, Self

MAX_MAGNITUDE = 1e75  # no value in SI units is larger; the fourth power does not overflow
_USUAL_DEGREES, _MAX_DEGREES = 15.0, 720.0  # multiples of angles in degrees
_MIN_POSITIVE = 1e-75  # the fourth power does not underflow to zero
_MAX_REPR_LENGTH = 80  # characters of a value in a message
# Least ratio of `difflib.SequenceMatcher` of suggested names; that of count and about is 0.6.
_MIN_SIMILARITY = 0.62
CASADI_MISMATCH = "shapes or types of CasADi expressions do not match"
_MAX_MESSAGE_LENGTH = 200  # characters of a quoted exception
_MAX_PATH_LENGTH = 4096  # characters of a path, on any system
_MAX_NAME_LENGTH = 100  # characters of the name of a part
_NUMBER_WITH_UNIT = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*(?:[^\W\d_]|[°%])")


# Function (name of the part, name of the argument, value) that returns the valid value.
Converter = Callable[[str, str, Any], Any]


class BeamdaeError(ValueError):
    """Error in a model, a setting, a file or a command.

    The message begins with the name of the part, call, option or file.
    """


class MissingPackageError(BeamdaeError):
    """Error of a call that needs a package that cannot be imported.

    Attributes
    ----------
    reason
        The package, and why it cannot be imported.
    """

    def __init__(self, part: str, reason: str, remedy: str) -> None:
        super().__init__(f"{part}: {reason}; {remedy}.")
        self.reason = reason


class MissingModelError(BeamdaeError, AttributeError):
    """Error of an attribute of a saved run that needs the model of the run.

    It is also an AttributeError, so that `hasattr` returns False.
    """


class ArgumentError(BeamdaeError, TypeError):
    """Error of arguments that a class or function lacks or does not have; also a TypeError."""


class FileContentError(BeamdaeError):
    """Error of a file of results that cannot be read, is damaged, too large or of another kind.

    Attributes
    ----------
    path
        Path of the file.
    problem
        The message without the path of the file and without the remedy.
    remedy
        Advice at the end of the message.
    """

    def __init__(self, path: Path, problem: str, remedy: str) -> None:
        super().__init__(path, problem, remedy)
        self.path, self.problem, self.remedy = path, problem, remedy

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}; {self.remedy}."


class ProgressError(Exception):
    """Raised inside a call if the user's function `progress` raises an exception, `problem`.

    The call ends, and raises `problem` with the result so far as its attribute `partial`. This is
    not a BeamdaeError, which would end a run with the status "failed".
    """

    def __init__(self, problem: Exception) -> None:
        super().__init__(f"progress failed: {format_exception(problem)}")
        self.problem = problem


class BeamdaeWarning(UserWarning):
    """Warning that a result may be unreliable or incomplete."""


class InputWarning(BeamdaeWarning):
    """Warning about arguments or data that commands show before the analysis, not after it."""


class KernelWarning(UserWarning):
    """Warning that a kernel cannot be compiled or cached, so that runs are slower.

    It is also issued if another integrator is used because a package cannot be imported, or if
    fewer worker processes than requested can be started. This class is not derived from
    `BeamdaeWarning`: results agree within the tolerances of the runs.
    """


# Kinds of warnings that were shown: the filters that showed them, and the key of the message in
# Python's registry of shown warnings.
_shown_kinds: dict[tuple[str, str, int], tuple[list[Any], list[Any], tuple[Any, ...]]] = {}
# Digits in names such as "link1" distinguish parts.
_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+(?:\.\d+)?(?:e[-+]?\d+)?|nan|inf)(?!\w)")

# Lists of the active `record_messages`.
_message_lists: ContextVar[tuple[list[str], ...]] = ContextVar("message_lists", default=())
# List of the innermost active `hold_messages`.
_held_messages: ContextVar[list[str] | None] = ContextVar("held_messages", default=None)


@contextmanager
def record_messages() -> Iterator[list[str]]:
    """List the different messages of `warn_user` within a `with` block, which are also issued.

    Filters do not apply to the list: it is part of a result, whether Python shows it or not.
    """
    messages: list[str] = []
    token = _message_lists.set((*_message_lists.get(), messages))
    try:
        yield messages
    finally:
        _message_lists.reset(token)


@contextmanager
def hold_messages() -> Iterator[list[str]]:
    """List the messages of `warn_user` within a `with` block instead of issuing them."""
    messages: list[str] = []
    token = _held_messages.set(messages)
    try:
        yield messages
    finally:
        _held_messages.reset(token)


def record_warnings(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate an analysis: its result lists the messages that the call issued in `warnings`.

    They follow those that the result already contains. The same applies to a partial result of the
    call.
    """

    @wraps(function)
    def call(*arguments: Any, **settings: Any) -> Any:
        def add(result: Any) -> None:
            set_fields(result, warnings=tuple(dict.fromkeys([*result.warnings, *messages])))

        with record_messages() as messages:
            try:
                result = function(*arguments, **settings)
            except KeyboardInterrupt as problem:
                partial = getattr(problem, "partial", None)
                if partial is not None and getattr(problem, "call", "") == function.__name__:
                    add(partial)
                raise
        add(result)
        return result

    return call


def warnings_are_ignored() -> bool:
    """Return True if each `BeamdaeWarning` issued now would be neither shown nor listed."""
    if _held_messages.get() is not None or _message_lists.get():
        return False
    filters: list[Any] = warnings.filters  # type: ignore[assignment]
    for action, text, category, module, line in filters:
        if text is None and module is None and not line and issubclass(BeamdaeWarning, category):
            return action == "ignore"
        applies = issubclass(category, BeamdaeWarning) or issubclass(BeamdaeWarning, category)
        if applies and action != "ignore":
            return False
    return False


def kind_of_message(message: str) -> str:
    """Return a key that is equal if messages differ only in numbers after their first colon."""
    part, colon, rest = message.partition(": ")
    return part + colon + _NUMBER.sub("0", rest)


def merge_parts(warned: Iterable[tuple[str, float, str]], most: int = 3) -> Iterator[str]:
    """Yield one warning for all parts with the same one, that of the part with the largest error.

    Parameters
    ----------
    warned
        Name of each part, size of its error, and the warning, "name: text".
    most
        Number of other parts that are named.
    """
    parts = [(name, size, text.removeprefix(f"{name}: ")) for name, size, text in warned]
    if not parts:
        return
    worst, _, text = max(parts, key=lambda x: x[1])
    others = dict.fromkeys(name for name, _, _ in parts if name != worst)
    yield f"{name_with_others(worst, list(others), most)}: {text}"


def merge_alike(messages: Iterable[str]) -> Iterator[str]:
    """Yield warnings of parts, the first of those that differ only in the part and in numbers.

    It names the other parts.
    """
    kinds: dict[str, list[str]] = {}
    for message in messages:
        _, colon, text = message.partition(": ")
        kinds.setdefault(kind_of_message(f": {text}") if colon else message, []).append(message)
    for first, *others in kinds.values():
        part, colon, text = first.partition(": ")
        names = dict.fromkeys(x.partition(": ")[0] for x in others if x != first)
        yield f"{name_with_others(part, list(names))}{colon}{text}" if names else first


def warn_user(
    message: str, category: type[BeamdaeWarning] = BeamdaeWarning, *, merges: bool = True
) -> None:
    """Issue a `BeamdaeWarning` that cites the line outside this package that led to it.

    Python shows a text only once per line. Messages that differ only in numbers after their first
    colon are one kind, of which only the first is shown, for example in the runs of a loop, unless
    `merges` is False. As for Python, this does not apply if filters show every warning or turn
    warnings into errors.
    """
    _issue(message, category, merges=merges)


def warn_of_incomplete_result(message: str) -> None:
    """Issue the warning that a result is not the requested one, such as an unfinished run.

    Unlike other warnings, it is shown for every result, also if its text and line are the same.
    """
    _issue(message, BeamdaeWarning, always=True)


def warn_of_result(messages: Iterable[str], build_warnings: Iterable[str] = ()) -> None:
    """Issue the warnings of a result, except those that were issued when its model was built."""
    issued = set(build_warnings)
    for message in messages:
        if message not in issued:
            _issue(message, BeamdaeWarning, merges=True)


def _issue(
    message: str,
    category: type[BeamdaeWarning],
    *,
    merges: bool = False,
    always: bool = False,
) -> None:
    held_messages = _held_messages.get()
    if held_messages is not None:
        held_messages.append(message)
        return
    for messages in _message_lists.get():
        if message not in messages:
            messages.append(message)
    frame = inspect.currentframe()
    inner = {"beamdae", "contextlib"}  # decorators may be context managers
    while frame and str(frame.f_globals.get("__name__", "")).partition(".")[0] in inner:
        frame = frame.f_back
    if frame is None:
        # Commands of this package have no such line.
        warnings.warn(message, category, stacklevel=2)
        return
    file, line = frame.f_code.co_filename, frame.f_lineno
    module = frame.f_globals.get("__name__") or "<unknown>"
    if always:
        # Python remembers shown warnings in the registry: a new one makes it show this one again.
        warnings.warn_explicit(message, category, file, line, module, registry={})
        return
    kind = kind_of_message(message), file, line
    filters: list[Any] = warnings.filters  # type: ignore[assignment]
    registry = frame.f_globals.setdefault("__warningregistry__", {})
    last = _shown_kinds.get(kind)
    # The list is another one inside `catch_warnings`, and changes if a filter is added. Notebooks
    # clear the registry before each cell.
    if merges and last and last[0] is filters and last[1] == filters and last[2] in registry:
        return
    warnings.warn_explicit(message, category, file, line, module, registry)
    key = message, category, line
    if key in registry:
        # Python showed the warning and will not repeat it.
        _shown_kinds[kind] = filters, list(filters), key


# Messages of `warn_once` issued in this process.
_issued_messages: set[str] = set()


def warn_once(message: str) -> None:
    """Issue a `KernelWarning` unless this process has already issued the same message."""
    if message not in _issued_messages:
        _issued_messages.add(message)
        warnings.warn(message, KernelWarning, stacklevel=3)


def short_repr(value: Any) -> str:
    """Return the `repr` of a value on one line of at most 80 characters, for a message.

    Memory addresses are removed. If `repr` fails, the type of the value is described instead.
    """
    try:
        text = repr(str(value) if isinstance(value, Path) else plain_text(value))
    except Exception:
        # For example, integers with thousands of digits.
        return f"a value of type {type(value).__name__}"
    return _shorten(text)


def format_exception(exception: BaseException) -> str:
    """Return the type and message of an exception raised by user code, on one line."""
    return ": ".join(filter(None, (type(exception).__name__, format_message(exception))))


def format_message(exception: BaseException) -> str:
    """Return the message of an exception raised by user code, on one line.

    The line has at most 200 characters and no final period. If CasADi raised the exception, a
    clearer message is returned. If the message cannot be formatted, an empty string is returned.
    """
    trace = exception.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is not None and Path(trace.tb_frame.f_code.co_filename).parent.name == "casadi":
        return CASADI_MISMATCH
    return _shorten(exception_text(exception), _MAX_MESSAGE_LENGTH).rstrip(".")


def exception_text(exception: BaseException) -> str:
    """Return the complete message of an exception, or an empty string if `__str__` fails."""
    try:
        return str(exception)
    except Exception:
        # The __str__ of a user's exception may fail.
        return ""


def _shorten(text: str, max_length: int = _MAX_REPR_LENGTH) -> str:
    line = " ".join(re.sub(r" at 0x[0-9a-fA-F]+", "", text[: 10 * max_length]).split())
    printable = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)
    return printable if len(printable) <= max_length else f"{printable[: max_length - 3]}..."


def working_folder() -> Path:
    """Return the working folder, or the root folder if the working folder has been deleted."""
    try:
        return Path.cwd()
    except OSError:
        return Path(os.sep)


def require_valid_path(path: Path) -> None:
    """Require a path of printable characters that operating systems accept; see `is_valid_path`."""
    if not is_valid_path(str(path)):
        raise BeamdaeError(
            f"path: {short_repr(str(path))} is not a valid file name; use at most 4096 printable "
            "characters."
        )


def is_valid_path(text: str) -> bool:
    """Return True if all characters of a path are printable and there are at most 4096."""
    return text.isprintable() and len(text) <= _MAX_PATH_LENGTH


def as_real(value: Any) -> float | None:
    """Return a real number as a float, possibly infinite or nan, and None for other values.

    NumPy scalars, zero-dimensional arrays, fractions and decimals are accepted if they are real
    numbers. Strings, booleans, lists of one number and symbols are not.
    """
    if type(value) is float:
        # Most numbers of a model; the checks below take ten times as long.
        return value
    value = unbox_scalar(value)
    if isinstance(value, bool) or not isinstance(value, (Real, Decimal)):
        return None
    try:
        return float(value)
    except OverflowError:
        # Raised by large integers and fractions.
        return -math.inf if value < 0 else math.inf
    except ValueError:
        return math.nan
    except Exception:
        # The methods of a user's number may fail.
        return None


def unbox_scalar(value: Any) -> Any:
    """Return a NumPy scalar or zero-dimensional array as a Python scalar, or `value` unchanged.

    Instances of subclasses of str are returned as plain strings. Masked values are returned
    unchanged, because `item` would return the number behind the mask.
    """
    try:
        is_scalar = getattr(value, "ndim", None) == 0 and not bool(getattr(value, "mask", False))
        return plain_text(value.item() if is_scalar else value)
    except Exception:
        # The attributes of a user's object may fail.
        return plain_text(value)


def as_text(value: Any) -> str | None:
    """Return an instance of str or a subclass as a plain string; None for other values."""
    # The methods of a subclass may fail.
    return str.__str__(value) if isinstance(value, str) else None


def plain_text(value: Any) -> Any:
    """Return an instance of str or a subclass as a plain string; other values unchanged."""
    text = as_text(value)
    return value if text is None else text


def path_as_text(value: Any) -> str | None:
    """Return a string or a `Path` as a string, and None for other values."""
    try:
        return str(value) if isinstance(value, Path) else as_text(value)
    except Exception:
        # The methods of a subclass of Path may fail.
        return None


def read_attribute(value: Any, name: str) -> Any:
    """Return an attribute of an object, or None if it is missing or fails."""
    try:
        return getattr(value, name, None)
    except Exception:
        # The attributes of a user's object may fail.
        return None


def is_instance(value: Any, protocol: type) -> bool:
    """Return `isinstance(value, protocol)`, and False if the attributes of the value fail."""
    try:
        return isinstance(value, protocol)
    except Exception:
        # Protocols with data read the attributes of a user's object.
        return False


class NumberWithUnit(float):
    """Value of a model parameter with its unit; formulas give plain floats."""

    parameter: str
    unit: str

    def __new__(cls, value: float, parameter: str, unit: str) -> Self:
        """Return the number with the name and the unit of its parameter."""
        number = super().__new__(cls, value)
        number.parameter, number.unit = parameter, unit
        return number

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (float(self), self.parameter, self.unit)


class UnconvertedNumber(NumberWithUnit):
    """Value of a model parameter whose unit is not an SI unit.

    Parts reject it: a function that passes such a parameter on has not converted it.
    """


def require_finite(part: str, name: str, value: Any) -> float:
    """Return `value` as a float, or raise BeamdaeError.

    The value must be a real number of at most 1e75 in absolute value. `part` and `name` begin the
    message.
    """
    if type(value) is float and -MAX_MAGNITUDE <= value <= MAX_MAGNITUDE:
        return value
    if isinstance(value, UnconvertedNumber):
        raise BeamdaeError(
            f"{part}: {name} must be in SI units, got the parameter {value.parameter} in "
            f"{value.unit}; convert it in the model function, or declare the parameter in the SI "
            f"unit, for which values such as '{float(value):g} {value.unit}' are converted."
        )
    number = as_real(value)
    if number is None:
        text = as_text(unbox_scalar(value))
        if text is not None and _NUMBER_WITH_UNIT.match(text):
            raise BeamdaeError(
                f"{part}: {name} must be a number in SI units, got {short_repr(text)}; convert the "
                "value, and omit the unit."
            )
        raise BeamdaeError(
            f"{part}: {name} must be a number, got {short_repr(unbox_scalar(value))}."
        )
    if not math.isfinite(number):
        raise BeamdaeError(f"{part}: {name} must be finite, got {short_repr(unbox_scalar(value))}.")
    if abs(number) > MAX_MAGNITUDE:
        most, given = format_distinct(MAX_MAGNITUDE, number)
        raise BeamdaeError(f"{part}: {name} must not exceed {most} in absolute value, got {given}.")
    return number


def require_positive(part: str, name: str, value: Any) -> float:
    """Return `value` as a float of at least 1e-75, or raise BeamdaeError."""
    number = require_finite(part, name, value)
    if number <= 0.0:
        raise BeamdaeError(f"{part}: {name} must be positive, got {number:g}.")
    if number < _MIN_POSITIVE:
        raise BeamdaeError(f"{part}: {name} must be at least {_MIN_POSITIVE:g}, got {number:g}.")
    return number


def require_non_negative(part: str, name: str, value: Any) -> float:
    """Return `value` as a float >= 0, or raise BeamdaeError."""
    number = require_finite(part, name, value)
    if number < 0.0:
        raise BeamdaeError(f"{part}: {name} must not be negative, got {number:g}.")
    return number


def require_between(part: str, name: str, value: Any, least: float, most: float) -> float:
    """Return `value` as a float from `least` to `most`, or raise BeamdaeError."""
    number = require_finite(part, name, value)
    if not least <= number <= most:
        low, high, given = format_distinct(least, most, number)
        raise BeamdaeError(f"{part}: {name} must lie in [{low}, {high}], got {given}.")
    return number


def warn_of_degrees(part: str, name: str, angle: float) -> None:
    """Warn of an angle [rad] of more than a full turn that is a usual number of degrees."""
    if 2.0 * math.pi < abs(angle) <= _MAX_DEGREES and angle % _USUAL_DEGREES == 0.0:
        warn_user(
            f"{part}: {name} = {angle:g} rad is more than a full turn; pass radians, such as "
            f"math.radians({angle:g}), or subtract full turns."
        )


def require_count(part: str, name: str, value: Any, least: int = 1, most: int | None = None) -> int:
    """Return `value` as an integer from `least` to `most` (None: no limit), or raise an error."""
    number = require_finite(part, name, value)
    if number != int(number) or number < least:
        raise BeamdaeError(
            f"{part}: {name} must be a whole number of at least {least}, "
            f"got {short_repr(unbox_scalar(value))}."
        )
    if most is not None and number > most:
        raise BeamdaeError(f"{part}: {name} must be at most {most}, got {number:g}.")
    return int(number)


def require_sequence(part: str, name: str, value: Any, what: str) -> list[Any]:
    """Return the entries of a list, tuple or other sequence, or of an array.

    Entries that are instances of subclasses of str become plain strings. Sets, strings and
    iterators are rejected with a BeamdaeError; `what` describes the expected value in its message.
    """
    # Most sequences are tuples or lists; the check of the abstract class takes ten times as long.
    is_sequence = type(value) in (tuple, list) or (
        isinstance(value, Sequence) and not isinstance(value, (str, bytes, bytearray))
    )
    try:
        dimensions = getattr(value, "ndim", 0)
        if is_sequence or (isinstance(dimensions, int) and dimensions > 0):
            return [plain_text(x) if isinstance(x, str) else x for x in value]
    except Exception as problem:
        # The methods of a user's sequence may fail.
        raise _unreadable_error(part, name, value, what, problem) from None
    raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")


def require_iterable(
    part: str, name: str, value: Any, what: str, most: int | None = None
) -> list[Any]:
    """Return the first `most` items of an iterable (None: all items).

    Items that are instances of subclasses of str become plain strings. Values that cannot be
    iterated are rejected with a BeamdaeError; `what` describes the expected value in its message.
    """
    try:
        return [plain_text(item) for item in islice(value, most)]
    except Exception:  # CasADi symbols declare __iter__ but cannot be iterated.
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.") from None


def require_names(part: str, name: str, value: Any, what: str) -> list[str]:
    """Return the strings of an iterable, or a single string in a list.

    Instances of subclasses of str become plain strings. Other values are rejected with a
    BeamdaeError; `what` describes the expected value in its message.
    """
    entries = require_iterable(part, name, [value] if isinstance(value, str) else value, what)
    if not all(isinstance(entry, str) for entry in entries):
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")
    return entries


def require_mapping(part: str, name: str, value: Any, what: str) -> dict[str, Any]:
    """Return a mapping with strings as keys as a dictionary.

    Keys and values that are instances of subclasses of str become plain strings. Other mappings and
    values are rejected with a BeamdaeError; `what` describes the expected value in its message.
    """
    entries = require_entries(part, name, value, what)
    if not all(isinstance(key, str) for key in entries):
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")
    return entries


def require_entries(part: str, name: str, value: Any, what: str) -> dict[Any, Any]:
    """Return a mapping with any keys as a dictionary; see `require_mapping`."""
    try:
        if isinstance(value, Mapping):
            return {plain_text(key): plain_text(value[key]) for key in value}
    except Exception as problem:
        # The methods of a user's mapping may fail.
        raise _unreadable_error(part, name, value, what, problem) from None
    raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")


def _unreadable_error(
    part: str, name: str, value: Any, what: str, problem: Exception
) -> BeamdaeError:
    return BeamdaeError(
        f"{part}: {name} must be {what}, but {short_repr(value)} cannot be read: "
        f"{format_exception(problem)}."
    )


def require_keywords(part: str, settings: Mapping[str, Any], function: Callable[..., Any]) -> None:
    """Raise BeamdaeError if a keyword in `settings` is not an argument of `function`."""
    allowed = [x.name for x in inspect.signature(function).parameters.values()]
    for name in settings:
        if name not in allowed:
            raise BeamdaeError(
                f"{part}: there is no argument {name!r}{suggest(name, allowed)}; the further "
                f"arguments are those of {function.__name__}."
            )


def require_pair(part: str, name: str, value: Any, what: str = "a pair (x, y)") -> tuple[Any, Any]:
    """Return the two entries of `value`, or raise BeamdaeError.

    `what` describes the expected value in the message.
    """
    entries = require_sequence(part, name, value, what)
    if len(entries) != 2:
        raise BeamdaeError(f"{part}: {name} must be {what}, got {short_repr(value)}.")
    return entries[0], entries[1]


def require_point(part: str, name: str, value: Any) -> tuple[float, float]:
    """Return `value` as a pair (x, y) of finite numbers, or raise BeamdaeError."""
    x, y = require_pair(part, name, value)
    return require_finite(part, f"{name} x", x), require_finite(part, f"{name} y", y)


def optional(convert: Converter) -> Converter:
    """Return a converter of values that may be None."""
    return lambda part, name, value: None if value is None else convert(part, name, value)


def choice_of(*choices: Any) -> Converter:
    """Return a converter that requires one of the choices."""
    return lambda part, name, value: require_choice(part, name, value, choices)


def require_progress(part: str, progress: Any, count: int = 1) -> None:
    """Raise BeamdaeError unless `progress` is None or a function of `count` arguments.

    Classes are rejected.
    """
    if progress is None:
        return
    if not callable(progress) or isinstance(progress, type):
        raise BeamdaeError(f"{part}: progress must be a function, got {short_repr(progress)}.")
    try:
        inspect.signature(progress).bind(*range(count))
    except ValueError:
        return  # Some built-in functions have no signature.
    except TypeError:
        raise BeamdaeError(
            f"{part}: progress must be a function that accepts {format_count(count, 'argument')}, "
            f"got {short_repr(progress)}."
        ) from None


def call_progress(progress: Callable[..., Any], *status: Any) -> Any:
    """Return the result of the user's function `progress`, or raise `ProgressError`."""
    try:
        return progress(*status)
    except Exception as problem:
        raise ProgressError(problem) from problem


def require_choice(part: str, name: str, value: Any, choices: Sequence[Any]) -> Any:
    """Return `value` if it equals one of `choices` in value and type, or raise BeamdaeError."""
    for choice in choices:
        if value is choice:
            return value
    value = unbox_scalar(value)
    if not any(type(value) is type(choice) and value == choice for choice in choices):
        raise BeamdaeError(
            f"{part}: {name} must be one of {', '.join(map(repr, choices))}, "
            f"got {short_repr(value)}{suggest(value, choices)}."
        )
    return value


def suggest(value: Any, choices: Iterable[Any]) -> str:
    """Return the hint " (did you mean 'x'?)" with the closest choice, or "" if none is close.

    It has the first letter of the value, which typing errors rarely change: a taper is no damper.
    """
    text = (as_text(value) or short_repr(value))[:_MAX_REPR_LENGTH]

    def first_letter(text: str) -> str:
        return next(filter(str.isalnum, text), "").lower()

    similar = [x for x in map(str, choices) if first_letter(x) == first_letter(text)]
    closest = difflib.get_close_matches(text, similar, n=1, cutoff=_MIN_SIMILARITY)
    return f" (did you mean {closest[0]!r}?)" if closest else ""


def list_first(names: Sequence[str], most: int = 3) -> str:
    """Return the names separated by commas; of more than `most`, the others are counted."""
    listed = ", ".join(names[:most])
    return f"{listed} and {len(names) - most} more" if len(names) > most else listed


def name_with_others(first: str, others: Sequence[str], most: int = 3) -> str:
    """Return "first (also a, b, c and 2 more)", with at most this many of the others by name."""
    return f"{first} (also {list_first(others, most)})" if others else first


def join_names(names: Iterable[str]) -> str:
    """Join names as "a, b and c"."""
    *first, last = names
    return " and ".join(filter(None, (", ".join(first), last)))


def format_count(count: int, noun: str) -> str:
    """Return a count with its noun in the singular or the plural, such as "2 points"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def format_distinct(*values: float, digits: int = 6) -> list[str]:
    """Format numbers that a message compares, with enough digits to tell different ones apart.

    Parameters
    ----------
    *values
        Numbers; those that differ in their sign alone or are not finite need no more digits.
    digits
        Least number of significant digits.
    """
    sizes = {abs(x) for x in values if math.isfinite(x)}
    enough = (k for k in (digits, 9, 12, 15) if len({f"{x:.{k}g}" for x in sizes}) == len(sizes))
    count = next(enough, 17)
    return [f"{x:.{count}g}" for x in values]


def format_percent(fraction: float, digits: int = 2) -> str:
    """Return a fraction in percent with these significant digits, such as "2.1 %" or "130 %"."""
    percent = f"{100.0 * fraction:.{digits}g}"
    return f"{float(percent):.0f} %" if "e+" in percent else f"{percent} %"


def set_fields(instance: Any, **values: Any) -> None:
    """Set attributes of an instance, even of a frozen dataclass."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


def convert_fields(instance: Any, **converters: Converter) -> None:
    """Replace fields of an instance, even of a frozen dataclass, by valid values.

    The field `name`, if there is one, is checked first; messages begin with it, otherwise with the
    name of the class. `converters` are functions such as `require_positive`, by field.
    """
    part = type(instance).__name__
    if hasattr(instance, "name"):
        part = require_name(part, instance.name)
        set_fields(instance, name=part)
    for field, convert in converters.items():
        set_fields(instance, **{field: convert(part, field, getattr(instance, field))})


def require_name(kind: str, name: Any) -> str:
    """Return `name` if it is a valid name for results, or raise BeamdaeError.

    Names of parts, points, observables and events appear in results, for example in the column
    header "name.x [m]". `kind` begins the message.
    """
    name = plain_text(name)
    if type(name) is str and _is_valid_name(name):
        return name
    if not isinstance(name, str) or not name.strip():
        raise BeamdaeError(f"{kind}: the name must be a non-empty string, got {short_repr(name)}.")
    if _has_forbidden_characters(name):
        raise BeamdaeError(
            f"{kind}: a name must not start with =, +, - or @, contain [ or ], or start or end "
            f"with a space, got {short_repr(name)}."
        )
    raise BeamdaeError(
        f"{kind}: a name must have at most {_MAX_NAME_LENGTH} characters and no line breaks "
        f"or other control characters, got {short_repr(name)}."
    )


# Models are often built again with the same names.
@lru_cache(maxsize=1024)
def _is_valid_name(name: str) -> bool:
    is_short = 0 < len(name) <= _MAX_NAME_LENGTH
    return is_short and name.isprintable() and not _has_forbidden_characters(name)


def _has_forbidden_characters(name: str) -> bool:
    # Spreadsheets read a cell that begins with one of these signs as a formula.
    return name[0] in "=+-@" or name != name.strip() or bool(set(name) & set("[]"))


def require_unit(part: str, unit: Any) -> str:
    """Return `unit` as a plain string, or raise BeamdaeError.

    A unit is a nonempty printable string without leading or trailing spaces; angles are in "rad".
    """
    unit = plain_text(unit)
    problem = _find_unit_problem(unit) if isinstance(unit, str) else _NO_UNIT
    if problem:
        raise BeamdaeError(f"{part}: {problem}, got {short_repr(unit)}.")
    return str(unit)


_NO_UNIT = "units must be strings such as 'm' and 'rad'"


# Models have hundreds of values with few units.
@lru_cache(maxsize=256)
def _find_unit_problem(unit: str) -> str:
    if not unit or unit != unit.strip() or not unit.isprintable():
        return _NO_UNIT
    if unit != "rad" and unit.lower() in ("rad", "radian", "radians", "deg", "degree", "degrees"):
        return "angles must be in 'rad'"
    return ""


def explain_arguments(value: Any) -> Any:
    """Return a class or function whose calls list their arguments.

    The constructor and the public class methods of a class, or the function, raise
    `ArgumentError` if a keyword is none of these, an argument is missing or there are too many. A
    function is also replaced in its module, so that it can be pickled.
    """
    if inspect.isfunction(value):
        explained = _explain(value.__name__, value, 0)
        setattr(sys.modules[value.__module__], value.__name__, explained)
        return explained
    if isinstance(value, type):
        constructor = value.__init__  # type: ignore[misc]
        if inspect.isfunction(constructor):
            value.__init__ = _explain(value.__name__, constructor, 1)  # type: ignore[misc]
        for name, method in list(vars(value).items()):
            if isinstance(method, classmethod) and not name.startswith("_"):
                function = _explain(f"{value.__name__}.{name}", method.__func__, 1)
                setattr(value, name, classmethod(function))
    return value


def _explain(part: str, function: Callable[..., Any], bound: int) -> Callable[..., Any]:
    """Return a function that lists its arguments but the first `bound` ones."""

    @wraps(function)
    def call(*arguments: Any, **settings: Any) -> Any:
        try:
            return function(*arguments, **settings)
        except Exception as problem:
            if isinstance(problem, TypeError):
                signature = inspect.signature(function)
                if misuse := _describe_misuse(signature, bound, arguments, settings):
                    raise ArgumentError(f"{part}: {misuse}.") from None
            problem.__traceback__ = _select_frames(problem)
            raise

    return call


def _select_frames(problem: Exception) -> TracebackType | None:
    """Return the traceback of an error without frames of this package, which users cannot mend.

    Unexpected errors inside the package keep theirs.
    """
    paths, package = sysconfig.get_paths(), str(Path(__file__).parent) + os.sep
    libraries = tuple(paths[x] for x in ("stdlib", "purelib", "platlib"))
    entries, entry = list[tuple[bool, TracebackType]](), problem.__traceback__
    while entry is not None:
        code = entry.tb_frame.f_code
        is_own = code.co_filename.startswith(package)
        # Constructors of dataclasses have no file.
        is_library = code.co_filename.startswith(libraries) or code.co_qualname.startswith(
            "__create_fn__"
        )
        if is_own or not is_library:
            entries.append((is_own, entry))
        entry = entry.tb_next
    if not isinstance(problem, BeamdaeError) and entries[-1][0]:
        return problem.__traceback__
    selected: TracebackType | None = None
    for is_own, x in reversed(entries):
        if not is_own:
            selected = TracebackType(selected, x.tb_frame, x.tb_lasti, x.tb_lineno)
    return selected


def _describe_misuse(
    signature: inspect.Signature, bound: int, arguments: tuple[Any, ...], settings: dict[str, Any]
) -> str:
    """Return why arguments do not fit a function, "" if they do; the first `bound` are bound."""
    parameters = list(signature.parameters.values())[bound:]
    public = [x.name for x in parameters if not x.name.startswith("_")]
    allowed = f"the arguments are {join_names(public)}" if public else "it has none"
    unknown = next((x for x in settings if x not in signature.parameters), None)
    if unknown is not None and not any(x.kind is x.VAR_KEYWORD for x in parameters):
        hint = _suggest_parameters(arguments[bound:], settings, unknown, "parameters" in public)
        return f"there is no argument {unknown!r}{hint or f'{suggest(unknown, public)}; {allowed}'}"
    try:
        signature.bind(*arguments, **settings)
    except TypeError as problem:
        return f"{problem}; {allowed}"
    return ""


def _suggest_parameters(
    arguments: tuple[Any, ...], settings: dict[str, Any], unknown: str, has_parameters: bool
) -> str:
    """Return the end of a message if an argument contains parameters of a model function.

    Functions without an argument `parameters` accept the mechanism that the model returns.
    """
    model: Any = settings.get("model", arguments[0] if arguments else None)
    known = getattr(model, "parameter_info", {})
    values = settings[unknown] if unknown == "parameters" else {unknown: settings[unknown]}
    if not (known and isinstance(values, dict) and set(values) <= set(known)):
        return ""
    if has_parameters:
        return f"; pass parameters={short_repr(values)}"
    texts = (f"{name}={short_repr(value)}" for name, value in values.items())
    return f"; pass parameters to the model function, as in {model.name}({', '.join(texts)})"
