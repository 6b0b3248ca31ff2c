"""Tasks of a study: cases with a time limit, their outcomes, and the progress of a study."""

from __future__ import annotations

import re
import time as clock
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.equations.measures import TIME
from beamdae.errors import call_progress, format_exception, short_repr
from beamdae.function_pickler import pickle_with_functions
from beamdae.read_only import read_only_data
from beamdae.results.outcome import REACHED_END, Status
from beamdae.results.storage.documents import ContentError, FileKind, read_bytes
from beamdae.studies.case import Case

if TYPE_CHECKING:
    import pandas as pd


Array = np.ndarray

# Status of a case whose model was measured; it has no rows.
MEASURED = Status("ok", "measured without a run")
# Characters without a special meaning in file systems and shells are kept.
_INVALID_CHARACTERS = re.compile(r"[^\w=.+]+")
TRAJECTORY = FileKind("trajectory", "run the case again")
_MAX_NAME_BYTES = 100  # of a trajectory file
_KEY_DIGITS = 8  # in the name of a trajectory file


@dataclass(frozen=True)
class Task:
    """A case to be run, and the key of its stored outcome.

    Attributes
    ----------
    key
        Hash that identifies the outcome: `Case.fingerprint`, in sweeps with outputs combined with a
        hash of the outputs.
    case
        The case.
    t_end, output_step
        End time and time between rows [s].
    time_limit
        Maximum wall time of each repetition [s], without the assembly; None for no limit.
    repetitions
        Number of runs; an unsuccessful run is the last. The last run is recorded, with the median
        and the extremes of all wall times.
    frames
        Number of frames of the animation that the outcome includes; 0 for no animation.
    mechanism_fingerprint
        `Case.mechanism_fingerprint`, or "" if it is unknown.
    outputs
        Functions of the solution by name; their values are recorded.
    is_measured
        True if the outputs are functions of the model, which is not run.
    is_checked
        True if the errors of the run are measured by a refined one, for its warnings.
    """

    key: str
    case: Case
    t_end: float
    output_step: float
    time_limit: float | None = None
    repetitions: int = 1
    frames: int = 0
    mechanism_fingerprint: str = ""
    outputs: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    is_measured: bool = False
    is_checked: bool = False

    @property
    def file(self) -> str:
        """Name of the trajectory file: a valid file name on all systems, unique by the key."""
        text = unicodedata.normalize("NFC", f"{self.case.group}-{self.case.label}")
        name = _INVALID_CHARACTERS.sub("-", text).encode()[:_MAX_NAME_BYTES]
        return f"{name.decode(errors='ignore').strip('-.')}-{self.key[:_KEY_DIGITS]}.csv"

    def serialize(self) -> bytes:
        """Serialize the task for another process, including the code of the model."""
        self.case.model.origin  # noqa: B018 reads the units from the docstring once for all copies
        return pickle_with_functions(self)


@read_only_data
@dataclass(frozen=True)
class Rows:
    """Observed columns, energies and drift of a run by output time [s].

    Attributes
    ----------
    headers
        Headers of the columns after the time.
    source
        Times and columns (k, 1 + columns), or the CSV file that contains them.
    """

    headers: tuple[str, ...]
    source: Array | Path

    @property
    def numbers(self) -> Array:
        """Times and columns (k, 1 + columns); FileContentError if the file cannot be read."""
        if isinstance(self.source, np.ndarray):
            return self.source
        text = read_bytes(self.source, TRAJECTORY).partition(b"\n")[2]
        with TRAJECTORY.errors_of(self.source):
            cells = text.replace(b"\n", b",").split(b",")[:-1]
            numbers = np.array([cell or b"nan" for cell in cells], bytes).astype(float)
            if not len(numbers):
                raise ContentError("the file has no rows")
            return numbers.reshape(-1, 1 + len(self.headers))

    def table(self) -> pd.DataFrame:
        """Return the columns as a new table, indexed by time."""
        # Imported here, because worker processes create no tables.
        import pandas as pd

        numbers = self.numbers
        times = pd.Index(numbers[:, 0], name=TIME)
        return pd.DataFrame(numbers[:, 1:].copy(), times, pd.Index(self.headers))


@read_only_data
@dataclass(frozen=True)
class Outcome:
    """Result of a task.

    Attributes
    ----------
    status
        Status at the end of the run, with the reason.
    values
        Settings, cost, quality, events and outputs by column of the case table; may be empty if the
        run was not completed.
    rows
        Trajectory; None if none was recorded, for example without a consistent start.
    measures
        Measures of the observed columns, see `measure_rows`.
    frames
        Shapes of the bodies over time for an animation; None unless requested.
    read
        Hashes of the files that were read, by name; see `digest_reads`.
    errors
        Measured errors of the observed columns, see `measured_errors`.
    file
        Name of the stored trajectory file, or "".
    text
        Content of the trajectory file before it is stored, formatted by the process of the case.
    kernel_warnings
        Messages about machine code in the process of the case; not stored.
    is_final
        False if the run is repeated when the study resumes, because a process or a cluster failed.
    """

    status: Status = REACHED_END
    values: dict[str, Any] = field(default_factory=dict)
    rows: Rows | None = field(default=None, repr=False)
    measures: dict[str, list[float]] = field(default_factory=dict, repr=False)
    frames: dict[str, Any] | None = None
    read: dict[str, str | None] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict, repr=False)
    file: str = ""
    text: bytes = field(default=b"", repr=False)
    kernel_warnings: tuple[str, ...] = ()
    is_final: bool = True

    @property
    def table(self) -> pd.DataFrame | None:
        """Observed columns, energies and drift by time as a new table, or None."""
        return None if self.rows is None else self.rows.table()

    @classmethod
    def failed(cls, sentence: str) -> Outcome:
        """Return a failed outcome without values."""
        return cls(Status("failed", sentence))


NOT_RUN = Outcome(Status("interrupted", "not run because the study was interrupted"))


def describe_exception(problem: BaseException, function: str = "the model") -> str:
    """Describe an exception of a user function for the status of a run."""
    if isinstance(problem, SystemExit):
        code = "" if problem.code is None else short_repr(problem.code)
        return f"{function} called sys.exit({code})"
    return format_exception(problem)


@dataclass(frozen=True)
class StudyProgress:
    """Progress of a study.

    Attributes
    ----------
    total
        Number of runs, including references.
    done
        Number of runs that have ended or were stored before.
    failed
        Number of runs in `done` that were not successful.
    stored
        Number of runs whose outcome was already stored in the results folder.
    running
        Number of runs in progress, assuming that no worker is idle.
    last_label
        Label of the run that ended last; "" at the start.
    remaining_time
        Estimated remaining time [s]; None until a run has ended.
    """

    total: int
    done: int
    failed: int
    stored: int
    running: int
    last_label: str
    remaining_time: float | None = None


def count_runs(
    tasks: Sequence[Task],
    outcomes: Mapping[str, Outcome],
    workers: int,
    progress: Callable[[StudyProgress], None] | None,
) -> Callable[..., None]:
    """Return a function that reports the progress after a run.

    Its arguments are the label and the outcome of the run, or "" at the start.

    `outcomes` are those by key of the task, to which the caller adds.
    """
    start, stored = clock.monotonic(), len(outcomes)
    failed = sum(not outcome.status.success for outcome in outcomes.values())

    def report(last_label: str, outcome: Outcome | None = None) -> None:
        nonlocal failed
        failed += outcome is not None and not outcome.status.success
        if progress is None:
            return
        missing, ended = len(tasks) - len(outcomes), len(outcomes) - stored
        elapsed = clock.monotonic() - start
        remaining = 0.0 if not missing else elapsed * missing / ended if ended else None
        running = min(workers, missing)
        call_progress(
            progress,
            StudyProgress(
                len(tasks), len(outcomes), failed, stored, running, last_label, remaining
            ),
        )

    return report
