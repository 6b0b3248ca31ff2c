"""Model files: Python files that define models, imported from their paths, and examples."""

from __future__ import annotations

import builtins
import importlib.util
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import wraps
from pathlib import Path
from types import CodeType, ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from beamdae.cli.process import RUNS, import_before_models
from beamdae.errors import (
    BeamdaeError,
    format_message,
    path_as_text,
    plain_text,
    require_valid_path,
    short_repr,
    suggest,
)
from beamdae.input_files import reading_inputs, register_input
from beamdae.model_functions import Model, extend_import_path

if TYPE_CHECKING:
    from beamdae.studies.definition import Study


PREFIX = "example:"
Choice = TypeVar("Choice")

# Python 3.13 and later suggest arguments themselves.
_SUGGESTION = re.compile(r"\. Did you mean '\w+'\?$")


def examples_folder() -> Path:
    """Return the folder of the examples, which is next to the package in a source checkout."""
    import beamdae

    package = Path(beamdae.__file__).parent
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "models"


def example_names() -> list[str]:
    """Return the names of all examples in alphabetical order."""
    files = examples_folder().glob("*.py")
    return sorted(file.stem for file in files if file.stem != "__init__")


def resolve_path(path: Path) -> Path:
    """Return the path of a model file; `example:NAME` becomes the file of that example.

    Raises
    ------
    BeamdaeError
        If no example has this name.
    """
    text = str(path)
    return example_file(text.removeprefix(PREFIX)) if text.startswith(PREFIX) else path


def example_file(name: str) -> Path:
    """Return the file of an example.

    Raises
    ------
    BeamdaeError
        If no example has this name.
    """
    names = example_names()
    if name not in names:
        raise BeamdaeError(
            f"{PREFIX}{name}: there is no example {short_repr(name)}{suggest(name, names)}; "
            f"available examples: {', '.join(names)}."
        )
    return examples_folder() / f"{name}.py"


def describe_error(problem: BaseException, path: Path) -> str:
    """Describe an exception in one line: type, line number in `path`, message and suggestion."""
    file_names = (path, path.absolute())
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(problem.__traceback__)
        if Path(frame.filename) in file_names
    ]
    message = format_message(problem).replace(".__init__()", "()")
    suggestion = _suggest_name(problem)
    if suggestion:
        message = _SUGGESTION.sub("", message)
    if isinstance(problem, SystemExit):
        code = "" if problem.code is None else short_repr(problem.code)
        message = f"sys.exit({code}) was called"
    if isinstance(problem, SyntaxError):
        # str() repeats the line number, and the error may be in an imported file.
        is_elsewhere = problem.filename is not None and Path(problem.filename) not in file_names
        place = f" of {problem.filename}" if is_elsewhere else ""
        lines, message = [problem.lineno or 1], f"{problem.msg}{place}"
    line = f" at line {lines[-1]}" if lines else ""
    text = f": {message}" if message else ""
    return f"{type(problem).__name__}{line}{text}{suggestion}"


def _suggest_name(problem: BaseException) -> str:
    """Return a suggestion for the name that an exception reports as missing, or ""."""
    missing, names = getattr(problem, "name", None) or "", []
    if isinstance(problem, AttributeError):
        with suppress(Exception):  # of the object
            names = dir(problem.obj)
    elif isinstance(problem, NameError):
        *_, (frame, _) = traceback.walk_tb(problem.__traceback__)
        names = [*frame.f_globals, *frame.f_locals, *dir(builtins)]
    is_private = missing.startswith("_")
    return suggest(missing, [x for x in names if is_private or not x.startswith("_")])


def load_model(path: str | Path, name: str | None = None) -> Model:
    """Load a model from a file, by `name` if the file contains several.

    A study file loads the model it studies:
    `pendulum = bd.load_model(Path(__file__).parent / "pendulum.py")`. The models installed with
    beamdae are files called `example:NAME`, such as `bd.load_model("example:four_bar")`.

    Parameters
    ----------
    path
        Path of the file, or "example:NAME".
    name
        Name of the model function. Defaults to the only model in the file.

    Returns
    -------
    Model
        The model; a call such as `model(rise=0.2)` builds the mechanism.

    Raises
    ------
    BeamdaeError
        If `path` is not a path, the file is missing, its import fails, it does not contain exactly
        one model called `name`, or `name` is None and it does not contain exactly one model.

    Examples
    --------
    >>> import beamdae as bd
    >>> four_bar = bd.load_model("example:four_bar")
    >>> four_bar.parameters["rise"]
    0.12
    >>> mech = four_bar(rise=0.2)
    """
    text = path_as_text(path)
    if text is None:
        raise BeamdaeError(f"load_model: path must be a model file, got {short_repr(path)}.")
    return ModelFile(Path(text)).model(plain_text(name))


class ModelFile:
    """An imported model file.

    Parameters
    ----------
    path
        Path of the file, or `example:NAME`.
    needs
        What is done with the models, which determines the modules that are imported before the
        file: `process.RUNS` or `process.MODELS`.

    Raises
    ------
    BeamdaeError
        If the file is missing or its import fails.
    """

    def __init__(self, path: Path, needs: str = RUNS) -> None:
        self.path = resolve_path(path)
        self._module = _import_file(self.path, needs)

    @property
    def models(self) -> dict[str, Model]:
        """Models of the file by name. An error in a model function becomes a `BeamdaeError`."""
        return {
            model.name: replace(model, build=_translate_build_errors(model, self.path))
            for model in self._all_models()
        }

    @property
    def studies(self) -> dict[str, Study]:
        """Studies and sweeps of the file by name."""
        # The file has imported this module if it contains a study; models load faster without it.
        if "beamdae.studies.definition" not in sys.modules:
            return {}
        from beamdae.studies.definition import Study

        studies = [value for value in vars(self._module).values() if isinstance(value, Study)]
        return {study.name: study for study in studies}

    @property
    def integrators(self) -> dict[str, Any]:
        """Integrators of the file, classes and instances, by the name of their public variable."""
        from beamdae.integrators import Integrator

        def is_integrator(value: Any) -> bool:
            if isinstance(value, type):
                return issubclass(value, Integrator) and not inspect.isabstract(value)
            return isinstance(value, Integrator)

        return {
            name: value
            for name, value in vars(self._module).items()
            if not name.startswith("_") and is_integrator(value)
        }

    def model(self, name: str | None = None) -> Model:
        """Return the model called `name`, or the only model of the file.

        Raises
        ------
        BeamdaeError
            If the file contains no model, no model or several models have this name, or the file
            contains several models and `name` is None.
        """
        models = self.models
        if not models:
            raise BeamdaeError(
                f"{self.path}: the file contains no model; decorate a function with "
                "@bd.model(t_end=...)."
            )
        model = select_by_name(self.path, "model", models, name)
        # A model that is assigned to two variables is counted once.
        functions = {id(x.build) for x in self._all_models() if x.name == model.name}
        if len(functions) > 1:
            raise BeamdaeError(
                f"{self.path}: {len(functions)} models are called {short_repr(model.name)}; "
                "give the functions different names."
            )
        return model

    def _all_models(self) -> list[Model]:
        return [value for value in vars(self._module).values() if isinstance(value, Model)]


def select_by_name(
    path: Path, kind: str, choices: Mapping[str, Choice], name: str | None
) -> Choice:
    """Return the model, study or sweep of a file called `name`; the only one if `name` is None.

    Raises
    ------
    BeamdaeError
        If there is none with this name, or `name` is None and there are several.
    """
    if name is None and len(choices) > 1:
        raise BeamdaeError(
            f"{path}: the file contains more than one {kind} ({', '.join(choices)}); choose one by "
            "name (--model)."
        )
    if name is None:
        return next(iter(choices.values()))
    if not (isinstance(name, str) and name in choices):
        raise BeamdaeError(
            f"{path}: there is no {kind} {short_repr(name)}{suggest(name, choices)}; choose one "
            f"of: {', '.join(choices)}."
        )
    return choices[name]


@contextmanager
def translate_errors(call: str, path: Path) -> Iterator[None]:
    """Convert exceptions of a model file, except Ctrl-C, to a `BeamdaeError` that names `call`."""
    try:
        yield
    except (BeamdaeError, KeyboardInterrupt):
        raise
    except BaseException as problem:
        raise BeamdaeError(f"{call} failed: {describe_error(problem, path)}.") from problem


def _import_file(path: Path, needs: str) -> ModuleType:
    code = _compile_file(path)
    # Import first: the model file, or a file in its folder, may shadow modules used by beamdae.
    import_before_models(needs)

    name = f"beamdae_model_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path.absolute())
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    # Decorators such as dataclass look up their module during the import.
    sys.modules[name] = module
    folder = path.absolute().parent
    try:
        with (
            extend_import_path(folder),
            reading_inputs(folder),
            translate_errors(f"{path}: the import", path),
        ):
            exec(code, vars(module))
    finally:
        sys.modules.pop(name, None)
    return module


def _compile_file(path: Path) -> CodeType:
    """Compile a file in its declared encoding, by default UTF-8."""
    require_valid_path(path)
    if path.suffix != ".py":
        file, separator, name = path.name.rpartition(":")
        remedy = ""
        if separator and file.endswith(".py") and name:
            remedy = f"; choose a model of the file {path.with_name(file)} by name (--model {name})"
        raise BeamdaeError(f"{path}: a model file must be a Python file (.py){remedy}.")
    try:
        if not path.exists():
            raise BeamdaeError(f"{path}: there is no such file.")
        if not path.is_file():
            raise BeamdaeError(
                f"{path}: the path is not a regular file; a model file must be a Python file (.py)."
            )
        content = path.read_bytes()
    except OSError as problem:
        raise BeamdaeError(f"{path}: the file cannot be read: {problem.strerror}.") from problem
    register_input(path)
    with translate_errors(f"{path}: the import", path):
        source = importlib.util.decode_source(content)
        return compile(source, path.absolute(), "exec", dont_inherit=True)


def _translate_build_errors(model: Model, path: Path) -> Callable[..., Any]:
    """Return the model function, wrapped to convert its exceptions to a `BeamdaeError`."""

    @wraps(model.build)
    def build(**values: Any) -> Any:
        with translate_errors(f"{model.name}: the model function in {path}", path):
            return model.build(**values)

    return build
