"""Models and studies of files, imported in a separate process with a time limit."""

from __future__ import annotations

import inspect
import pickle
import signal
from collections.abc import Generator, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.cli import startup
from beamdae.errors import BeamdaeError
from beamdae.python_processes import isolated_processes

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from beamdae.model_functions import Model

# A file of models is imported in less than a second; a script that runs simulations is not.
_MAX_IMPORT_TIME = 10.0  # s
# Includes the import of beamdae in the process, which takes seconds on a busy machine.
_MAX_START_TIME = 60.0  # s


@dataclass(frozen=True)
class FileContent:
    """Rows that describe the models and studies of a file.

    Attributes
    ----------
    models, studies
        One dict per model, and one per study or sweep.
    problem
        Reason why the file cannot be imported, otherwise empty.
    """

    models: list[dict[str, Any]] = field(default_factory=list)
    studies: list[dict[str, Any]] = field(default_factory=list)
    problem: str = ""


def read_files(files: Iterable[Path]) -> Generator[FileContent, None, None]:
    """Yield the content of each file.

    A file whose import takes over 10 s or ends the process is reported as a problem. The process is
    killed when the generator is closed, also by an interrupt.
    """
    process = _ListingProcess()
    try:
        for file in files:
            content = process.read(file)
            if content is None:
                process.kill()
                process = _ListingProcess()
                content = FileContent(
                    problem=f"{file}: the import takes over {_MAX_IMPORT_TIME:g} s or ends the "
                    "process; move code that computes below if __name__ == '__main__'."
                )
            yield content
    finally:
        process.kill()


class _ListingProcess:
    """Process that imports files, one at a time."""

    def __init__(self) -> None:
        # Imported here because browsers lack it, and other commands do not need it.
        from multiprocessing import get_context

        context = get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_serve_files, args=(other,), daemon=True)
        with other, isolated_processes():
            self._process.start()
        self._is_ready = False

    def read(self, file: Path) -> FileContent | None:
        """Return the content of a file, or None if the process does not answer."""
        try:
            if not self._is_ready:
                if not self._connection.poll(_MAX_START_TIME):
                    return None
                self._connection.recv_bytes()
                self._is_ready = True
            self._connection.send_bytes(str(file).encode("utf-8", "surrogateescape"))
            if not self._connection.poll(_MAX_IMPORT_TIME):
                return None
            content = pickle.loads(self._connection.recv_bytes())
        except (EOFError, OSError):
            return None
        assert isinstance(content, FileContent)
        return content

    def kill(self) -> None:
        self._process.kill()
        self._process.join()
        self._connection.close()


def _serve_files(connection: Connection) -> None:
    """Main function of the process; interrupts are handled by the main process, which kills it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    startup.begin_startup()
    # Importing CasADi and NumPy must not count as import of a file.
    startup.import_before_models(startup.MODELS)
    from beamdae.cli.model_files.model_file import ModelFile

    connection.send_bytes(b"ready")
    while True:
        try:
            file = Path(connection.recv_bytes().decode("utf-8", "surrogateescape"))
        except (EOFError, OSError):
            return
        try:
            model_file = ModelFile(file, startup.MODELS)
            content = _describe_content(file, model_file)
        except BeamdaeError as problem:
            content = FileContent(problem=str(problem))
        connection.send_bytes(pickle.dumps(content))


def _describe_content(file: Path, model_file: Any) -> FileContent:
    studies = model_file.studies
    return FileContent(
        # A study file imports the models of other files.
        [
            {
                "name": model.name,
                "t_end": model.t_end,
                "file": str(file),
                "parameters": {name: _plain(x) for name, x in model.parameters.items()},
                "units": {x.name: x.unit for x in model.parameter_info.values() if x.unit},
                "descriptions": {
                    x.name: x.description for x in model.parameter_info.values() if x.description
                },
                "about": model.summary,
            }
            for model in model_file.models.values()
            if not studies or _is_defined_in(model, file)
        ],
        [
            {
                "name": study.name,
                "cases": len(study.cases),
                "file": str(file),
                "models": list(dict.fromkeys(case.model.name for case in study.cases)),
            }
            for study in studies.values()
        ],
    )


def _plain(value: Any) -> Any:
    """Return a plain value unchanged, and any other value as text, which every process can load."""
    return value if value is None or type(value) in (bool, int, float, str) else str(value)


def _is_defined_in(model: Model, file: Path) -> bool:
    source = inspect.unwrap(model.build).__code__.co_filename
    return Path(source).resolve() == file.resolve()
