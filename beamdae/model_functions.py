"""Model functions: keyword defaults are the parameters, calling them builds a mechanism."""

from __future__ import annotations

import ast
import inspect
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from beamdae.errors import (
    BeamdaeError,
    as_real,
    require_finite,
    require_positive,
    require_sequence,
    set_fields,
    short_repr,
    suggest,
    unbox_scalar,
)

_LONGEST_NAME = 120
# What no file on some system may be called, whatever follows its first dot.
_RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{x}{k}" for x in ("COM", "LPT") for k in range(10))}
_SEPARATING = frozenset('/\\:*?"<>|')


class Origin(NamedTuple):
    """Which model built something, with which parameters, and its end time [s]."""

    name: str
    parameters: dict[str, Any]
    t_end: float


class HasOrigin:
    """What models build; it knows the model it is from, or None."""

    origin: Origin | None = None


@dataclass(frozen=True)
class Model:
    """A function with named parameters that builds a mechanism (or a constrained system).

    Attributes
    ----------
    build
        The decorated function.
    t_end
        Default end time [s].
    parameters
        Defaults by name; their types are the types of the parameters.
    data
        Files its results depend on besides those Python opens while it is built and run.
    """

    build: Callable[..., Any]
    t_end: float
    parameters: dict[str, Any]
    data: Sequence[str] = ()

    def __post_init__(self) -> None:
        _require_function(self.build)
        require_file_name("model: build", self.name)
        if not isinstance(self.parameters, dict) or not all(
            isinstance(name, str) for name in self.parameters
        ):
            raise BeamdaeError(
                f"{self.name}: parameters must be a dict of values by name, "
                f"got {short_repr(self.parameters)}."
            )
        files = tuple(require_sequence(self.name, "data", self.data, "a list of names of files"))
        for name in files:
            if not isinstance(name, str) or not name.isprintable() or not name:
                raise BeamdaeError(
                    f"{self.name}: data must be a list of names of files, got {short_repr(name)}."
                )
        set_fields(self, t_end=require_positive(self.name, "t_end", self.t_end), data=files)

    @property
    def name(self) -> str:
        """Name of the function."""
        return self.build.__name__

    @property
    def summary(self) -> str:
        """First line of the docstring of the function, or of its module."""
        of_file = inspect.unwrap(self.build).__globals__.get("__doc__")
        lines = (self.build.__doc__ or of_file or "").strip().splitlines()
        return lines[0] if lines else ""

    @property
    def home(self) -> Path:
        """The folder of the file the function stands in, or the working directory."""
        file = Path(inspect.unwrap(self.build).__code__.co_filename)
        return file.absolute().parent if file.is_file() else Path.cwd()

    def files(self) -> list[Path]:
        """The files of `data`: beside the model's own file, and in the working directory.

        Raises
        ------
        BeamdaeError
            If one of them is in neither.
        """
        found = []
        for name in self.data:
            places = {folder / name: None for folder in (self.home, Path.cwd())}
            there = [place for place in places if os.path.isfile(place)]
            if not there:
                raise BeamdaeError(
                    f"{self.name}: data must name files beside {self.home / '*.py'} or in the "
                    f"working directory, there is no file {short_repr(name)}."
                )
            found += there
        return found

    def __call__(self, **values: Any) -> Any:
        """Build the mechanism, with `values` in place of the defaults."""
        parameters = self.complete(values)
        with extend_import_path(self.home):
            built = self.build(**parameters)
        if built is None or isinstance(built, Model):
            what = "None" if built is None else f"the model {built.name}"
            raise BeamdaeError(f"{self.name}: the function must return the mechanism, got {what}.")
        if isinstance(built, HasOrigin):
            set_fields(built, origin=Origin(self.name, parameters, self.t_end))
        return built

    @property
    def origin(self) -> Origin:
        """What is known of that which it builds with its defaults."""
        return Origin(self.name, self.parameters, self.t_end)

    def check(self, **settings: Any) -> Any:
        """What it is and what is wrong with it, see `beamdae.check`."""
        import beamdae

        return beamdae.check(self, **settings)

    def complete(self, values: dict[str, Any]) -> dict[str, Any]:
        """All parameters, checked: `values` over the defaults.

        Raises
        ------
        BeamdaeError
            On an unknown name or a value of the wrong type.
        """
        for name in values:
            if name not in self.parameters:
                allowed = ", ".join(self.parameters) or "none"
                raise BeamdaeError(
                    f"{self.name}: no parameter {short_repr(name)}{suggest(name, self.parameters)}, "
                    f"the parameters are {allowed}."
                )
        checked = {name: self._typed(name, value) for name, value in values.items()}
        return self.parameters | checked

    def _typed(self, name: str, value: Any) -> Any:
        kind = type(self.parameters[name])
        value = unbox_scalar(value)
        if isinstance(value, str) and kind is not str:
            value = self._parsed(name, value, kind)
        found = as_real(value)
        if kind is float and found is not None:
            return require_finite(self.name, name, value)
        if kind is int and found is not None and found.is_integer():
            return int(value)
        truth = isinstance(value, bool) and kind is not bool
        if kind is not type(None) and (truth or not isinstance(value, kind)):
            raise self._wrong(name, value)
        return value

    def _wrong(self, name: str, value: Any) -> BeamdaeError:
        kind = type(self.parameters[name]).__name__
        return BeamdaeError(f"{self.name}: {name} must be of type {kind}, got {short_repr(value)}.")

    def _parsed(self, name: str, text: str, kind: type) -> Any:
        if kind is bool:
            if text.lower() in ("true", "false"):
                return text.lower() == "true"
            raise BeamdaeError(
                f"{self.name}: {name} must be true or false, got {short_repr(text)}."
            )
        if kind not in (int, float, tuple, list, dict):
            # A default of None leaves the type open; an object is not to be told by a text.
            return text
        try:
            return kind(text) if kind in (int, float) else ast.literal_eval(text)
        except (TypeError, ValueError, SyntaxError, RecursionError, MemoryError):
            raise self._wrong(name, text) from None


def require_file_name(part: str, value: Any) -> str:
    """Return `value` as a name that files and folders may have on any system.

    Raises
    ------
    BeamdaeError
        If it has separators, control characters or none at all, begins with a dot, ends with a
        dot or a space, is reserved (CON, NUL, COM1), or longer than 120 bytes.
    """
    if not isinstance(value, str):
        raise BeamdaeError(f"{part}: its name must be a text, got {short_repr(value)}.")
    length = len(value.encode(errors="replace"))
    fits = 0 < length <= _LONGEST_NAME and value[0] not in ". " and value[-1] not in ". "
    if not (fits and value.isprintable() and not _SEPARATING & set(value)):
        raise BeamdaeError(
            f"{part}: its name must do as that of a folder, 1 to {_LONGEST_NAME} bytes of letters, "
            f"digits, _ - + = , and inner dots and spaces, got {short_repr(value)}."
        )
    if value.partition(".")[0].strip().upper() in _RESERVED:
        raise BeamdaeError(
            f"{part}: its name must do as that of a folder, and {value} is no folder on Windows."
        )
    return value


def _require_function(build: Any) -> None:
    if not inspect.isfunction(build):
        raise BeamdaeError(f"model: build must be a function, got {short_repr(build)}.")


def model(*, t_end: float, data: Sequence[str] = ()) -> Callable[[Callable[..., Any]], Model]:
    """Decorate a function that builds a mechanism.

    Parameters
    ----------
    t_end
        Its default end time [s].
    data
        Names of files its results depend on, beside its own file or in the working directory.
        Files Python opens are followed without that; it is for those that others open (HDF5,
        SQLite).

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
    require_positive("model", "t_end", t_end)

    def decorate(function: Callable[..., Any]) -> Model:
        _require_function(function)
        parameters = {}
        for parameter in inspect.signature(function).parameters.values():
            if parameter.default is parameter.empty or parameter.kind is parameter.POSITIONAL_ONLY:
                raise BeamdaeError(
                    f"{function.__name__}: the parameter {parameter.name!r} needs a default value "
                    "and must be given by name."
                )
            parameters[parameter.name] = unbox_scalar(parameter.default)
        made = Model(function, t_end, parameters, data)
        made.files()
        return made

    return decorate


@contextmanager
def extend_import_path(folder: Path) -> Iterator[None]:
    """Modules in a folder can be imported, as if a file there were run; none of them stays loaded.

    Another file may have others of the same names beside it, and another process that is sent what
    they define gets it whole.
    """
    if str(folder) in sys.path:
        yield
        return
    before = {name.partition(".")[0] for name in sys.modules}
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        with suppress(ValueError):
            sys.path.remove(str(folder))
        for name, module in list(sys.modules.items()):
            top = name.partition(".")[0]
            if top in before:
                continue
            own = (folder / f"{top}.py", folder / top)
            if any(Path(file).is_relative_to(x) for x in own for file in _module_locations(module)):
                del sys.modules[name]


def _module_locations(module: Any) -> list[str]:
    """The file of a module, or the folders of a package without one."""
    file = getattr(module, "__file__", None)
    return [file] if file else [str(x) for x in getattr(module, "__path__", ())]
