"""Tasks of a study: cases with limits, their outcomes, and transfer to other processes."""

from __future__ import annotations

import copyreg
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import _lru_cache_wrapper, cached_property, lru_cache
from typing import TYPE_CHECKING, Any, cast

from beamdae.errors import format_exception, require_positive, set_fields, short_repr
from beamdae.function_pickler import pickle_with_functions
from beamdae.read_only import read_only_data
from beamdae.results.outcome import REACHED_END, Status
from beamdae.studies.case import Case
from beamdae.studies.column_measures import measure_table
from beamdae.studies.run_values import TrajectoryRows

if TYPE_CHECKING:
    import pandas as pd

# Status of a case whose model was measured; it has no rows.
MEASURED = Status("ok", "measured without a run")


@dataclass(frozen=True)
class Limits:
    """Limits of a case; None means no limit.

    Attributes
    ----------
    time
        Maximum wall time of each repetition [s], excluding the assembly of the equations.
    memory
        Maximum memory of the process [GB].
    patience
        Wall time [s] within which the simulated time must advance by 1e-5 of the end time.

    Raises
    ------
    BeamdaeError
        If a limit is not positive.
    """

    time: float | None = None
    memory: float | None = None
    patience: float | None = None

    def __post_init__(self) -> None:
        for name in ("time", "memory", "patience"):
            if getattr(self, name) is not None:
                set_fields(self, **{name: require_positive("Limits", name, getattr(self, name))})


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
    limits
        Limits on wall time, memory and time without progress.
    repetitions
        Number of runs; an unsuccessful run is the last. The last run is recorded, with the median
        and the extremes of all wall times.
    frames
        Number of frames of the animation that the outcome includes; 0 for no animation.
    mechanism_fingerprint
        `Case.mechanism_fingerprint`, or "" if it is unknown.
    name
        Readable name of the trajectory file without suffix, unique in the study; "" to use `key`.
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
    limits: Limits = Limits()
    repetitions: int = 1
    frames: int = 0
    mechanism_fingerprint: str = ""
    name: str = ""
    outputs: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    is_measured: bool = False
    is_checked: bool = False

    def serialize(self) -> bytes:
        """Serialize the task for another process, including the code of the model."""
        self.case.model.origin  # noqa: B018 reads the units from the docstring once for all copies
        return pickle_with_functions(self)


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
    _rows
        Trajectory table, or a function that reads it; None if none was recorded, for example
        without a consistent start. `table` returns a copy.
    frames
        Shapes of the bodies over time for an animation; None unless requested.
    _measures
        Measures of the observed columns of the trajectory, see `measure_table`; None until they are
        needed, see `shared_measures`.
    read
        Hashes of the files that were read, by name; see
        `beamdae.studies.store.file_reads.digest_reads`.
    file
        Name of the stored trajectory file, or "".
    text
        Content of the trajectory file before it is stored, formatted by the process of the case.
    kernel_warnings
        Messages about machine code in the process of the case; not stored.
    """

    status: Status = REACHED_END
    values: dict[str, Any] = field(default_factory=dict)
    _rows: pd.DataFrame | Callable[[], pd.DataFrame] | None = field(default=None, repr=False)
    frames: dict[str, Any] | None = None
    read: dict[str, str | None] = field(default_factory=dict)
    file: str = ""
    text: bytes = field(default=b"", repr=False)
    kernel_warnings: tuple[str, ...] = ()
    _measures: dict[str, list[float]] | None = field(default=None, repr=False)

    @property
    def table(self) -> pd.DataFrame | None:
        """Observed columns, energies and drift by time as a new table, or None."""
        table = shared_table(self)
        return None if table is None else table.copy()

    @classmethod
    def failed(cls, sentence: str) -> Outcome:
        """Return a failed outcome without values."""
        return cls(Status("failed", sentence))


def shared_table(outcome: Outcome) -> pd.DataFrame | None:
    """Return `outcome.table` without a copy, for functions that only read it."""
    rows = vars(outcome)["_rows"]
    if callable(rows):
        rows = vars(outcome)["_rows"] = rows()
    return cast("pd.DataFrame | None", rows)


def read_table(outcome: Outcome) -> pd.DataFrame | None:
    """Return `outcome.table` without a copy; a table that must be read is not kept in memory."""
    rows = vars(outcome)["_rows"]
    return cast("pd.DataFrame | None", rows() if callable(rows) else rows)


def trajectory_columns(outcome: Outcome) -> list[str] | None:
    """Return the columns of `outcome.table`, which is not created, or None without a trajectory."""
    rows = vars(outcome)["_rows"]
    if isinstance(rows, TrajectoryRows):
        return list(rows.headers)
    table = shared_table(outcome)
    return None if table is None else [str(column) for column in table]


def shared_measures(outcome: Outcome) -> dict[str, list[float]]:
    """Return the measures of the observed columns of an outcome; empty without a trajectory."""
    measures = vars(outcome)["_measures"]
    if measures is None:
        table = shared_table(outcome)
        measures = vars(outcome)["_measures"] = {} if table is None else measure_table(table)
    return cast("dict[str, list[float]]", measures)


NOT_RUN = Outcome(Status("interrupted", "not run because the study was interrupted"))


def describe_exception(problem: BaseException, function: str = "the model") -> str:
    """Describe an exception of a user function for the status of a run."""
    if isinstance(problem, SystemExit):
        code = "" if problem.code is None else short_repr(problem.code)
        return f"{function} called sys.exit({code})"
    return format_exception(problem)


def _create_cached_property(
    function: Callable[[Any], Any], name: str | None
) -> cached_property[Any]:
    rebuilt = cached_property(function)
    if name is not None:
        rebuilt.__set_name__(object, name)
    return rebuilt


def _create_cached_function(
    function: Callable[..., Any], parameters: dict[str, Any]
) -> _lru_cache_wrapper[Any]:
    return lru_cache(**parameters)(function)


def _reduce_cached_function(function: _lru_cache_wrapper[Any]) -> Any:
    """Reduce an importable function to its name, and other functions to their definition."""
    module = sys.modules.get(function.__module__)
    if getattr(module, function.__qualname__, None) is function:
        return function.__qualname__
    return _create_cached_function, (function.__wrapped__, function.cache_parameters())


# Neither can be pickled: in CPython 3.11, a cached property contains a lock, and a cached function
# contains its cache.
copyreg.pickle(cached_property, lambda x: (_create_cached_property, (x.func, x.attrname)))
copyreg.pickle(_lru_cache_wrapper, _reduce_cached_function)
