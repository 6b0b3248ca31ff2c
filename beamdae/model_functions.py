"""Model functions: functions with default parameters that build mechanisms."""

from __future__ import annotations

import ast
import inspect
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

from beamdae.deferred import module
from beamdae.errors import (
    BeamdaeError,
    NumberWithUnit,
    UnconvertedNumber,
    as_real,
    plain_text,
    record_messages,
    require_finite,
    require_mapping,
    require_positive,
    require_sequence,
    set_fields,
    short_repr,
    suggest,
    unbox_scalar,
    working_folder,
)
from beamdae.input_files import reading_inputs, register_input
from beamdae.model_parameters import (
    ModelParameter,
    conversion_factor,
    convert_text,
    describe_parameters,
    format_with_unit,
    is_sequence,
    parse_quantity,
    parse_unit,
    parse_value,
    plain_value,
)
from beamdae.read_only import ReadOnlyDict, copy_containers

_P = ParamSpec("_P")
_R = TypeVar("_R")

_MAX_NAME_BYTES = 120
# Windows reserves these file names, with any suffix.
_RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{x}{k}" for x in ("COM", "LPT") for k in range(10))}
_INVALID_CHARACTERS = frozenset('/\\:*?"<>|')

_NUMBER_START = re.compile(r"[-+]?\.?\d")


class Origin(NamedTuple):
    """Name, parameters and end time [s] of the model that built a mechanism, and known units."""

    name: str
    parameters: dict[str, Any]
    t_end: float
    units: dict[str, str]


# Model and parameters of the mechanisms that model functions built, as long as these exist.
_built: WeakKeyDictionary[Any, tuple[Model, dict[str, Any]]] = WeakKeyDictionary()


class HasOrigin:
    """Base class of mechanisms and systems; `origin` is None unless a model built the object.

    `build_warnings` are the warnings issued while the model function ran.
    """

    origin: Origin | None = None
    build_warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Model:
    """Function with named parameters that builds a mechanism or a constrained system.

    The decorator `model` creates a `Model` from a function. Calling the `Model` builds the
    mechanism: `pendulum(elements=16)` replaces one default. Studies, sweeps and the command line
    set parameters by name.

    Parameters
    ----------
    build
        The function.
    t_end
        Default end time [s], positive.
    parameters
        Default values by name. The type of a default value is the type of the parameter; a default
        of None accepts any type. Arrays of numbers become tuples if the default is a tuple of
        floats.
    data
        Names of files on which the results depend; see `model`.

    Raises
    ------
    BeamdaeError
        If an argument has the wrong type, `t_end` is not positive, or the name of the function is
        not a valid file name.
    """

    build: Callable[..., Any]
    t_end: float
    parameters: dict[str, Any]
    data: Sequence[str] = ()

    def __post_init__(self) -> None:
        _require_function(self.build)
        require_file_name("model: build", self.name)
        parameters = require_mapping(
            self.name, "parameters", self.parameters, "a dict of values by name"
        )
        parameters = {name: plain_value(value) for name, value in parameters.items()}
        files = tuple(require_sequence(self.name, "data", self.data, "a list of file names"))
        for name in files:
            if not isinstance(name, str) or not name.isprintable() or not name:
                raise BeamdaeError(
                    f"{self.name}: data must be a list of file names, got {short_repr(name)}."
                )
        set_fields(
            self,
            t_end=require_positive(self.name, "t_end", self.t_end),
            parameters=ReadOnlyDict(copy_containers(parameters)),
            data=files,
        )

    @property
    def name(self) -> str:
        """Name of the model function."""
        return self.build.__name__

    @property
    def summary(self) -> str:
        """First line of the docstring of the function or, if missing, of its module; else ""."""
        module_docstring = inspect.unwrap(self.build).__globals__.get("__doc__")
        lines = (self.build.__doc__ or module_docstring or "").strip().splitlines()
        return lines[0] if lines else ""

    @property
    def parameter_info(self) -> dict[str, ModelParameter]:
        """Default, unit and description of each parameter, by name.

        Units and descriptions are those of `bd.param`, or are read from the docstring of the
        function: "`radius` [m]" states a unit, and the description is the first sentence that
        mentions the parameter.
        """
        signature = inspect.signature(self.build).parameters
        defaults = {name: x.default for name, x in signature.items()}
        return describe_parameters(self.build.__doc__ or "", self.parameters, defaults)

    def header(self, name: str) -> str:
        """Return the header of a parameter in tables, with its unit, such as "speed [rad/s]"."""
        info = self.parameter_info.get(name)
        return name if info is None or info.unit in ("", "-") else f"{name} [{info.unit}]"

    def __repr__(self) -> str:
        """Return the name of the model with its parameters and end time."""
        values = [f"{x.name}={self._format_default(x)}" for x in self.parameter_info.values()]
        return f"<Model {self.name}({', '.join(values)}), t_end={self.t_end:g} s>"

    def _repr_html_(self) -> str:
        """Return the parameters as a table, which notebooks display."""
        # Scripts and commands start faster without the table of all entities of HTML.
        from html import escape

        rows = [
            (x.name, self._format_default(x, with_unit=False), x.unit, x.description)
            for x in self.parameter_info.values()
        ]
        cells = "".join(f"<tr>{''.join(f'<td>{escape(x)}</td>' for x in row)}</tr>" for row in rows)
        head = "".join(f"<th>{x}</th>" for x in ("parameter", "default", "unit", "description"))
        return (
            f"<p><b>{escape(self.name)}</b>, {self.t_end:g} s. {escape(self.summary)}</p>"
            f"<table><tr>{head}</tr>{cells}</table>"
        )

    def _format_default(self, x: ModelParameter, with_unit: bool = True) -> str:
        if type(x.default) not in (int, float, bool):
            return short_repr(x.default)
        return format_with_unit(x.default, x.unit if with_unit else "")

    @property
    def home(self) -> Path:
        """Folder of the file that defines the function; without a file, the working directory."""
        file = Path(inspect.unwrap(self.build).__code__.co_filename)
        return file.absolute().parent if file.is_file() else working_folder()

    def files(self) -> list[Path]:
        """Return the paths of the files in `data`.

        A file that exists both in the folder of the model and in the working directory has two
        paths.

        Raises
        ------
        BeamdaeError
            If a file is in neither folder.
        """
        files = []
        for name in self.data:
            candidates = {folder / name: None for folder in (self.home, working_folder())}
            existing = [path for path in candidates if os.path.isfile(path)]
            if not existing:
                raise BeamdaeError(
                    f"{self.name}: data names the file {short_repr(name)}, which does "
                    f"not exist; put this file in {self.home} or in the working "
                    "directory."
                )
            files += existing
        return files

    def __call__(self, *unnamed: Any, **values: Any) -> Any:
        """Build the mechanism with `values` instead of the defaults.

        Parameters
        ----------
        **values
            Values by parameter name; all other parameters keep their defaults.

        Returns
        -------
        Mechanism or ConstrainedSystem
            The object that the function returns.

        Raises
        ------
        BeamdaeError
            If a value has no name or the wrong type, a name is unknown, or the function returns
            None or a `Model`.
        """
        if unnamed:
            # Parameters may be added anywhere among the others.
            pairs = zip(self.parameters, unnamed, strict=False)
            named = ", ".join(f"{name}={short_repr(value)}" for name, value in pairs)
            raise BeamdaeError(
                f"{self.name}: values of parameters need their names; write "
                f"{self.name}({named or '...'})."
            )
        parameters = self.complete(values)
        home = self.home
        with extend_import_path(home), reading_inputs(home), record_messages() as messages:
            # The function may change its arguments.
            mechanism = self.build(**copy_containers(parameters | self._with_units(parameters)))
        if mechanism is None or isinstance(mechanism, Model):
            what = "None" if mechanism is None else f"the model {mechanism.name}"
            raise BeamdaeError(f"{self.name}: the function must return a Mechanism, got {what}.")
        if isinstance(mechanism, HasOrigin):
            set_fields(mechanism, origin=self._origin(parameters), build_warnings=tuple(messages))
            with suppress(TypeError):  # classes without hash or weak references
                _built[mechanism] = self, parameters
        return mechanism

    @property
    def origin(self) -> Origin:
        """Origin of the mechanism that the model builds with default parameters."""
        return self._origin(self.parameters)

    def _origin(self, parameters: Mapping[str, Any]) -> Origin:
        values = ReadOnlyDict(copy_containers(dict(parameters)))
        return Origin(self.name, values, self.t_end, self._units)

    @property
    def _units(self) -> dict[str, str]:
        return self._units_and_checked_units[0]

    @cached_property
    def _units_and_checked_units(
        self,
    ) -> tuple[dict[str, str], dict[str, tuple[type[NumberWithUnit], str]]]:
        """Units by parameter, and those of floats and tuples of floats that parts check.

        These are units other than SI units, and N/m, which is wrong for nonlinear contacts.
        """
        parameters = [x for x in self.parameter_info.values() if x.unit not in ("", "-")]
        checked: dict[str, tuple[type[NumberWithUnit], str]] = {}
        for x in filter(lambda x: _has_floats(x.default), parameters):
            if (parse_unit(x.unit) or (1,))[0] != 1:
                checked[x.name] = UnconvertedNumber, x.unit
            elif conversion_factor(x.unit, "N/m") is not None:
                checked[x.name] = NumberWithUnit, x.unit
        return ReadOnlyDict({x.name: x.unit for x in parameters}), checked

    def view(
        self, ranges: Mapping[str, Any] | None = None, t_end: float | None = None, **settings: Any
    ) -> Any:
        """Show the model with sliders for its parameters, on a page of this computer.

        The drawing follows the sliders. Releasing a slider runs the model with `Auto(rtol=1e-3)`
        and animates the result. The page is served on 127.0.0.1 until the view is closed or Python
        ends; only programs of this computer that know the token in the address can use it.

        Parameters
        ----------
        ranges
            Pairs (first, last) of slider ends by parameter; numbers, or texts with units such as
            "500 mm". Sliders reach from a quarter of the default to four times the default, those
            of angles over a full turn; other parameters with a default of 0 have no slider.
        t_end
            End time of the runs [s]. Defaults to the model's end time.
        **settings
            `time_limit`, the maximum wall time of a run [s], by default 10; `port` of the server,
            by default a free one; and `browser`, which is True to open the page in the web browser.

        Returns
        -------
        LiveView
            The view, which notebooks display. `url` is its address, and `close` stops the server.

        Raises
        ------
        BeamdaeError
            If an argument is invalid, there is no end time, or the port is in use.

        Examples
        --------
        >>> import beamdae as bd
        >>> live = bd.load_model("example:pendulum").view({"radius": ("50 cm", "2 m")})
        >>> live.url.startswith("http://127.0.0.1:")
        True
        >>> live.close()
        """
        return module("live").view(self, ranges, t_end, **settings)

    def _with_units(self, parameters: dict[str, Any]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for name, (kind, unit) in self._units_and_checked_units[1].items():
            value = parameters[name]
            if isinstance(value, float):
                values[name] = kind(value, name, unit)
            else:
                values[name] = type(value)(
                    kind(x, name, unit) if isinstance(x, float) else x for x in value
                )
        return values

    def complete(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return all parameters: the defaults, updated with checked and converted `values`.

        Strings are converted to the types of the parameters, as on the command line; numbers may
        have a unit, as in "850 mm" and "(5 mm, 6 mm)". For a tuple or list of floats, all sequences
        and one-dimensional arrays of numbers are accepted.

        Parameters
        ----------
        values
            Values by parameter name.

        Raises
        ------
        BeamdaeError
            If a name is unknown, or a value has the wrong type or unit.
        """
        for name in values:
            if name not in self.parameters:
                parameter_names = ", ".join(self.parameters) or "none"
                raise BeamdaeError(
                    f"{self.name}: there is no parameter "
                    f"{short_repr(name)}{suggest(name, self.parameters)}; "
                    f"available parameters: {parameter_names}."
                )
        checked = {name: self._convert(name, value) for name, value in values.items()}
        return copy_containers(self.parameters | checked)

    def _convert(self, name: str, value: Any) -> Any:
        kind = type(self.parameters[name])
        value = plain_value(unbox_scalar(value))
        if isinstance(value, str) and kind is not str:
            value = self._parse(name, value, kind)
        value = self._convert_numbers(name, value)
        number = as_real(value)
        if kind is float and number is not None:
            return require_finite(self.name, name, value)
        if kind is int and number is not None and number.is_integer():
            return int(value)
        if kind in (int, float) and number is None:
            raise self._type_error(name, value)
        # A default of None accepts any type; bool is a subclass of int.
        is_bool = isinstance(value, bool) and kind is not bool
        if kind is not type(None) and (is_bool or not isinstance(value, kind)):
            raise self._type_error(name, value)
        return value

    def _convert_numbers(self, name: str, value: Any) -> Any:
        """Convert sequences of numbers and texts if the default is a tuple or list of floats."""
        default: Any = self.parameters[name]
        kind = type(default)
        if kind is float or not _has_floats(default) or not is_sequence(value):
            return value
        entries = require_sequence(self.name, name, value, "a list of numbers")
        unit = self.parameter_info[name].unit
        entries = [convert_text(self.name, f"an entry of {name}", x, unit) for x in entries]
        if any(as_real(x) is None for x in entries):
            return value
        return kind(require_finite(self.name, f"an entry of {name}", x) for x in entries)

    def _type_error(self, name: str, value: Any) -> BeamdaeError:
        kind = type(self.parameters[name]).__name__
        hint = ""
        if _has_floats(self.parameters[name]) and kind != "float":
            unit, numbers = self.parameter_info[name].unit, self.parameters[name]
            examples = ", ".join(format_with_unit(float(x), unit) for x in numbers)
            hint = f"; write its numbers as in {name}='[{examples}]'"
        elif kind in ("int", "float") and is_sequence(value):
            hint = f"; to pass a list or a number, write {name}=None as default"
        return BeamdaeError(
            f"{self.name}: {name} must be of type {kind}, got {short_repr(value)}{hint}."
        )

    def _parse(self, name: str, text: str, kind: type) -> Any:
        if kind is bool:
            if text.lower() in ("true", "false"):
                return text.lower() == "true"
            raise BeamdaeError(
                f"{self.name}: {name} must be true or false, got {short_repr(text)}."
            )
        if kind not in (int, float, tuple, list, dict):
            # A default of None accepts the string; `_convert` rejects other types.
            return text
        try:
            return kind(text) if kind in (int, float) else ast.literal_eval(text)
        except (TypeError, ValueError, SyntaxError, RecursionError, MemoryError):
            pass
        if kind in (int, float):
            number = parse_value(self.name, name, text, self.parameter_info[name].unit)
            if number is not None:
                return number
        elif _has_floats(self.parameters[name]) and (entries := _split_entries(text)):
            # `_convert_numbers` converts their units.
            return entries
        raise self._type_error(name, text)


def _split_entries(text: str) -> list[str]:
    """Return the entries of a text such as "(5 mm, 6 mm)"; empty if the text is no such list.

    Entries have units: in "5, 6 mm" and "5,5 mm, 6 mm", the value of the first entry is unclear.
    """
    inner = text.strip()
    brackets = inner[:1] + inner[-1:]
    if brackets in ("()", "[]"):
        inner = inner[1:-1]
    if "," not in inner and brackets != "[]":
        return []
    entries = [x.strip() for x in inner.strip().removesuffix(",").split(",")]
    are_numbers = all(_NUMBER_START.match(x) for x in entries)
    quantities = [parse_quantity(x) for x in entries]
    are_clear = all(x is None or x[1] or x[0] == 0.0 for x in quantities)
    return entries if are_numbers and are_clear else []


def _has_floats(value: Any) -> bool:
    """Return True for floats, and for tuples and lists of numbers with at least one float."""
    if type(value) not in (tuple, list):
        return type(value) is float
    is_real = all(as_real(x) is not None for x in value)
    return is_real and any(isinstance(x, float) for x in value)


def model_of(mechanism: Any) -> Model | None:
    """Return the model that built a mechanism, with its parameters as defaults, or None."""
    built = _built.get(mechanism)
    return None if built is None else replace(built[0], parameters=built[1])


def require_model_function(caller: str, model: Any) -> Model:
    """Return `model` if it is a model function; `caller` is the called function, for messages."""
    if not isinstance(model, Model):
        raise BeamdaeError(
            f"{caller}: model must be a model function, got {short_repr(model)}; decorate the "
            "function that builds the mechanism with bd.model, and pass it without calling it."
        )
    return model


def require_file_name(part: str, value: Any) -> str:
    """Return `value` if it is a valid file and folder name on all operating systems.

    Raises
    ------
    BeamdaeError
        If `value` is not a string or is empty, contains separators, control characters or any of
        : * ? " < > |, begins or ends with a dot or a space, is reserved by Windows (such as CON,
        NUL and COM1), or is longer than 120 bytes.
    """
    value = plain_text(value)
    if not isinstance(value, str):
        raise BeamdaeError(f"{part}: the name must be a string, got {short_repr(value)}.")
    length = len(value.encode(errors="replace"))
    fits = 0 < length <= _MAX_NAME_BYTES and value[0] not in ". " and value[-1] not in ". "
    if not (fits and value.isprintable() and not _INVALID_CHARACTERS & set(value)):
        raise BeamdaeError(
            f"{part}: the name must be a valid folder name, 1 to {_MAX_NAME_BYTES} "
            'bytes without control characters, / \\ : * ? " < > | and leading or trailing dots or '
            f"spaces, got {short_repr(value)}."
        )
    if value.partition(".")[0].strip().upper() in _RESERVED:
        raise BeamdaeError(
            f"{part}: the name must be a valid folder name, but Windows reserves "
            f"{value}; choose another name."
        )
    return value


def _require_function(build: Any) -> None:
    if not inspect.isfunction(build):
        raise BeamdaeError(f"model: build must be a function, got {short_repr(build)}.")


def model(
    *misplaced: Any, t_end: float | None = None, data: Sequence[str] = ()
) -> Callable[[Callable[..., Any]], Model]:
    """Return a decorator that turns a function that builds a mechanism into a `Model`.

    Every parameter of the function needs a default value. The defaults define the parameters of the
    model and their types. The docstring states units, as in "`radius` [m]"; `param` defines
    a default with a unit and a description.

    Parameters
    ----------
    t_end
        Default end time of a run [s], positive.
    data
        Names of files on which the results depend, in the folder of the model file or in the
        working directory. Files opened by Python are tracked automatically; list files that
        libraries open, such as HDF5 and SQLite files.

    Returns
    -------
    Callable
        Decorator that returns a `Model`.

    Raises
    ------
    BeamdaeError
        If `t_end` is missing or not positive. The decorator raises this error if it is not applied
        to a function, a parameter has no default or is positional-only, the name of the function is
        not a valid file name, or a file in `data` does not exist.

    Examples
    --------
    >>> import beamdae as bd
    >>> @bd.model(t_end=1.0)
    ... def swing(mass=2.0):
    ...     mech = bd.Mechanism(gravity=(0.0, -9.81))
    ...     mech.add(bd.PointMass("bob", mass, at=(1.0, 0.0)))
    ...     return mech
    >>> swing.parameters
    {'mass': 2.0}
    """
    if misplaced or t_end is None:
        raise BeamdaeError(
            "model: the end time of runs is not passed by name; write @bd.model(t_end=1.0) before "
            "the function."
        )
    end = require_positive("model", "t_end", t_end)

    def decorate(function: Callable[..., Any]) -> Model:
        _require_function(function)
        parameters = {}
        for parameter in inspect.signature(function).parameters.values():
            if parameter.default is parameter.empty or parameter.kind is parameter.POSITIONAL_ONLY:
                raise BeamdaeError(
                    f"{function.__name__}: the parameter {parameter.name!r} must have "
                    "a default value and must not be positional-only."
                )
            parameters[parameter.name] = unbox_scalar(parameter.default)
        decorated = Model(function, end, parameters, data)
        for file in (*decorated.files(), inspect.unwrap(function).__code__.co_filename):
            register_input(file)
        return decorated

    return decorate


@contextmanager
def extend_import_path(folder: Path) -> Iterator[None]:
    """Make the modules in a folder importable within the context, then unload them.

    Unloading avoids conflicts with modules of the same name next to another model file, and lets
    cloudpickle send objects of these modules to other processes by value. If the folder is already
    on the import path, nothing is changed.
    """
    if str(folder) in sys.path:
        yield
        return
    before = list(sys.modules)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        with suppress(ValueError):
            sys.path.remove(str(folder))
        # Two sets of all modules would take as long as a sixth of a small model. New modules are
        # the last ones.
        is_unchanged = len(sys.modules) == len(before) and next(reversed(sys.modules)) == before[-1]
        added = set() if is_unchanged else set(sys.modules).difference(before)
        # Models are built often, but rarely import modules.
        known = {name.partition(".")[0] for name in before} if added else set()
        for name in added:
            top = name.partition(".")[0]
            if top in known:
                continue
            roots = (folder / f"{top}.py", folder / top)
            locations = _module_locations(sys.modules[name])
            if any(Path(file).is_relative_to(root) for root in roots for file in locations):
                del sys.modules[name]


def _module_locations(module: Any) -> list[str]:
    """Return the file of a module, or the folders of a namespace package."""
    file = getattr(module, "__file__", None)
    return [file] if file else [str(x) for x in getattr(module, "__path__", ())]


def transform_mechanisms(model: Model, change: Callable[[Any], Any]) -> Model:
    """Return the model whose mechanisms are those of `model` after a change."""

    @wraps(model.build)
    def build(**values: Any) -> Any:
        return change(model.build(**values))

    return replace(model, build=build)
