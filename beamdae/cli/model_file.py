"""Model files: plain programs, imported from their path, that hold model functions."""

from __future__ import annotations

import importlib.util
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import wraps
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from beamdae.errors import BeamdaeError, nearest
from beamdae.model_functions import Model

if TYPE_CHECKING:
    from beamdae.studies import Study


def load_model(path: str | Path, name: str | None = None) -> Model:
    """The model of a file, by `name` if it holds several.

    A study file names the model it is about with it:
    `pendulum = bd.load_model(Path(__file__).parent / "pendulum.py")`.

    Raises
    ------
    BeamdaeError
        If the file does not import, or does not hold that one model.
    """
    path = Path(path)
    models = models_in(path)
    if not models:
        raise BeamdaeError(
            f"{path}: it holds no model, decorate a function with @bd.model(t_end=)."
        )
    if name is None and len(models) > 1:
        raise BeamdaeError(
            f"{path}: it holds several models, name one with --model: {', '.join(models)}."
        )
    if name is not None and name not in models:
        raise BeamdaeError(
            f"{path}: no model {name!r}{nearest(name, models)}, the models are {', '.join(models)}."
        )
    return models[name or next(iter(models))]


def models_in(path: Path) -> dict[str, Model]:
    """The models of a file by name; a mistake in them is told with its line.

    Raises
    ------
    BeamdaeError
        If the file is missing or does not import.
    """
    return _models(_imported(path), path)


def contents(path: Path) -> tuple[dict[str, Model], dict[str, Study]]:
    """The models and the studies of a file, by name.

    Raises
    ------
    BeamdaeError
        If the file is missing or does not import.
    """
    # Here, for a model is loaded faster without what studies need.
    from beamdae.studies import Study

    module = _imported(path)
    studies = [value for value in vars(module).values() if isinstance(value, Study)]
    return _models(module, path), {study.name: study for study in studies}


def _models(module: ModuleType, path: Path) -> dict[str, Model]:
    found = [value for value in vars(module).values() if isinstance(value, Model)]
    return {model.name: replace(model, build=_located(model, path)) for model in found}


def _imported(path: Path) -> ModuleType:
    if path.suffix != ".py":
        raise BeamdaeError(f"{path}: a model file must be a Python file (.py).")
    if not path.is_file():
        raise BeamdaeError(f"{path}: there is no such file.")
    name = f"beamdae_model_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Decorators such as dataclass look their module up while it is being imported.
    sys.modules[name] = module
    try:
        with _beside(path):
            spec.loader.exec_module(module)
    except (BeamdaeError, KeyboardInterrupt):
        raise
    except BaseException as problem:
        raise BeamdaeError(f"{path}: it does not import, {_explained(problem, path)}.") from problem
    finally:
        del sys.modules[name]
    return module


def _located(model: Model, path: Path) -> Callable[..., Any]:
    """The model function, with its programming errors told as mistakes in the file."""

    @wraps(model.build)
    def build(**values: Any) -> Any:
        try:
            with _beside(path):
                built = model.build(**values)
        except (BeamdaeError, KeyboardInterrupt):
            raise
        except BaseException as problem:
            raise BeamdaeError(
                f"{model.name}: {path} cannot build it, {_explained(problem, path)}."
            ) from problem
        if built is None:
            raise BeamdaeError(f"{model.name}: the function must return the mechanism, got None.")
        return built

    return build


@contextmanager
def _beside(path: Path) -> Iterator[None]:
    """Modules beside a file can be imported, as if it were run; none of them stays loaded.

    Another file may have others of the same names beside it, and another process that is sent what
    they define gets it whole.
    """
    folder = path.absolute().parent
    before = {name.partition(".")[0] for name in sys.modules}
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in list(sys.modules):
            top = name.partition(".")[0]
            file = getattr(sys.modules[name], "__file__", None)
            own = (folder / f"{top}.py", folder / top)
            if top not in before and file and any(Path(file).is_relative_to(x) for x in own):
                del sys.modules[name]


def _explained(problem: BaseException, path: Path) -> str:
    """Type, line of the model file and message of an exception."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(problem.__traceback__)
        if Path(frame.filename) == path.absolute() or Path(frame.filename) == path
    ]
    message = str(problem)
    if isinstance(problem, SystemExit):
        message = f"it called sys.exit({problem.code!r})"
    if isinstance(problem, SyntaxError):
        # Its own message repeats the place, and the place may be another file.
        where = (
            "" if problem.filename in (None, str(path.absolute())) else f" of {problem.filename}"
        )
        lines, message = [problem.lineno or 0], f"{problem.msg}{where}"
    line = f" at line {lines[-1]}" if lines else ""
    return f"{type(problem).__name__}{line}: {' '.join(message.split())[:200].rstrip('.')}"
