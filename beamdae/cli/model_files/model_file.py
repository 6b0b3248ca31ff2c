"""Model files: plain programs, imported from their path, that hold model functions."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import wraps
from pathlib import Path
from types import CodeType, ModuleType
from typing import TYPE_CHECKING, Any

from beamdae.cli.model_files.example_files import resolve_path
from beamdae.cli.model_files.user_errors import describe_error
from beamdae.errors import BeamdaeError, is_valid_path, short_repr, suggest
from beamdae.model_functions import Model, extend_import_path

if TYPE_CHECKING:
    from beamdae.studies import Study

# Bytes; compiling takes hundreds of times as much memory.
_MAX_FILE_SIZE = 10_000_000


def load_model(path: str | Path, name: str | None = None) -> Model:
    """The model of a file, by `name` if it holds several.

    A study file names the model it is about with it:
    `pendulum = bd.load_model(Path(__file__).parent / "pendulum.py")`. The models that come with
    beamdae are files called `example:NAME`, such as `bd.load_model("example:four_bar")`.

    Raises
    ------
    BeamdaeError
        If the file does not import, or does not hold that one model, or another by its name.

    Examples
    --------
    >>> import beamdae as bd
    >>> four_bar = bd.load_model("example:four_bar")
    >>> four_bar.parameters["rise"]
    0.12
    >>> mech = four_bar(rise=0.2)
    """
    if not isinstance(path, (str, Path)):
        raise BeamdaeError(
            f"load_model: path must be that of a model file, got {short_repr(path)}."
        )
    path = resolve_path(Path(path))
    module = _import_file(path)
    models = _models(module, path)
    if not models:
        raise BeamdaeError(
            f"{path}: it holds no model, decorate a function with @bd.model(t_end=)."
        )
    chosen = select_name(name, models, f"{path}: it holds several models")
    if not (isinstance(chosen, str) and chosen in models):
        raise BeamdaeError(
            f"{path}: no model {short_repr(chosen)}{suggest(chosen, models)}, "
            f"the models are {', '.join(models)}."
        )
    # The same under two names is one.
    called_so = {id(x.build) for x in _all_models(module) if x.name == chosen}
    if len(called_so) > 1:
        raise BeamdaeError(
            f"{path}: it holds {len(called_so)} models called {short_repr(chosen)}, give each a name of "
            "its own; that of a model is the name of its function."
        )
    return models[chosen]


def select_name(name: str | None, known: Iterable[str], several: str) -> str:
    """The name that is asked for, or that of the only one there is.

    Raises
    ------
    BeamdaeError
        If none is asked for and there are `several`.
    """
    names = list(known)
    if name is None and len(names) > 1:
        raise BeamdaeError(f"{several}, name one with --model: {', '.join(names)}.")
    return names[0] if name is None else name


def _all_models(module: ModuleType) -> list[Model]:
    return [value for value in vars(module).values() if isinstance(value, Model)]


def load_contents(path: Path) -> tuple[dict[str, Model], dict[str, Study]]:
    """The models and the studies of a file, by name.

    Raises
    ------
    BeamdaeError
        If the file is missing or does not import.
    """
    # Here, for a model is loaded faster without what studies need.
    from beamdae.studies import Study

    path = resolve_path(path)
    module = _import_file(path)
    studies = [value for value in vars(module).values() if isinstance(value, Study)]
    return _models(module, path), {study.name: study for study in studies}


def _models(module: ModuleType, path: Path) -> dict[str, Model]:
    return {x.name: replace(x, build=_wrap_build(x, path)) for x in _all_models(module)}


def _import_file(path: Path) -> ModuleType:
    code = _compile_file(path)
    # Before a file beside the model, or the model itself, can hide what these import.
    import beamdae.simulation  # noqa: F401

    name = f"beamdae_model_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path.absolute())
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    # Decorators such as dataclass look their module up while it is being imported.
    sys.modules[name] = module
    try:
        with (
            extend_import_path(path.absolute().parent),
            _report_errors(f"{path}: it does not import", path),
        ):
            exec(code, vars(module))
    finally:
        sys.modules.pop(name, None)
    return module


def _compile_file(path: Path) -> CodeType:
    """A model file, in whatever encoding its first lines tell, as code."""
    if not is_valid_path(str(path)):
        raise BeamdaeError(f"path: no model file can be called {short_repr(str(path))}.")
    if path.suffix != ".py":
        raise BeamdaeError(f"{path}: a model file must be a Python file (.py).")
    try:
        if not path.exists():
            raise BeamdaeError(f"{path}: there is no such file.")
        if not path.is_file():
            raise BeamdaeError(f"{path}: it is no file, a model file must be a Python file (.py).")
        if path.stat().st_size > _MAX_FILE_SIZE:
            raise BeamdaeError(
                f"{path}: it is larger than {_MAX_FILE_SIZE / 1e6:g} MB, a model file must be smaller; "
                "it can read its data from another file."
            )
        content = path.read_bytes()
    except OSError as problem:
        raise BeamdaeError(f"{path}: it cannot be read, {problem.strerror}.") from problem
    try:
        source = importlib.util.decode_source(content)
    except (SyntaxError, UnicodeDecodeError):
        raise BeamdaeError(
            f"{path}: it is no text in UTF-8, nor in the encoding its first line tells, as "
            "'# coding: latin-1' does."
        ) from None
    if "\0" in source:
        raise BeamdaeError(f"{path}: it holds NUL bytes, a model file must be text.")
    with _report_errors(f"{path}: it does not import", path):
        return compile(source, path.absolute(), "exec", dont_inherit=True)


def _wrap_build(model: Model, path: Path) -> Callable[..., Any]:
    """The model function, with its programming errors told as mistakes in the file."""

    @wraps(model.build)
    def build(**values: Any) -> Any:
        with _report_errors(f"{model.name}: {path} cannot build it", path):
            return model.build(**values)

    return build


@contextmanager
def _report_errors(what: str, path: Path) -> Iterator[None]:
    """Whatever the code of a file raises is a mistake in it, but Ctrl-C."""
    try:
        yield
    except (BeamdaeError, KeyboardInterrupt):
        raise
    except BaseException as problem:
        raise BeamdaeError(f"{what}, {describe_error(problem, path)}.") from problem
