"""Errors of the columns of a result, as a table, sentences and recommended settings."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from beamdae.errors import (
    BeamdaeError,
    format_percent,
    join_names,
    list_first,
    name_with_others,
)
from beamdae.linear.blas_threads import single_threaded
from beamdae.read_only import read_only_data
from beamdae.results.columns import AIM, FACTOR, LIMIT, remove_unit
from beamdae.results.displays import HasTable
from beamdae.results.outcome import Status

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

# Names of what is refined by cause, in the order in which it is refined one after the other.
CAUSES = {"time": "steps", "friction": "friction speed", "mesh": "elements", "theory": "strains"}
# About a state at rest, friction is zero or a damper, which a sharper one only enlarges.
CAUSES_AT_REST = frozenset({"mesh", "theory"})
_MAX_NAMES = 6
# Recommended elements are at most so often halved: larger errors do not decrease by their order.
_MAX_HALVINGS = 2
UNREQUIRED = Status("ok", "")
_ARRAYS = ("values", "companions", "total", "rows")  # of `Errors`


class Refined(NamedTuple):
    """What a companion refines.

    Attributes
    ----------
    elements
        Numbers of elements of the original beams by name; the companion has twice as many.
    degrees
        Degrees of the elements of beams whose mesh the program chose, by name; the companion has
        higher ones.
    inexact
        Names of the beams with exact strains instead of moderate ones.
    friction_speeds
        Names of the parts with a tenth of their friction speed.
    accuracy
        Name and value of the setting "rtol" or "step" that is refined; ("", 0.0) without.
    order
        Order of the integrator with fixed steps.
    kept
        Reasons why beams are not refined, by name.
    method
        Label of another integrator that is compared instead.
    mesh_order
        Order of errors by elements: 2 for rates and section forces, in which they are largest.
    """

    elements: Mapping[str, int] = {}
    degrees: Mapping[str, int] = {}
    inexact: tuple[str, ...] = ()
    friction_speeds: tuple[str, ...] = ()
    accuracy: tuple[str, float] = ("", 0.0)
    order: int = 1
    kept: Mapping[str, str] = {}
    method: str = ""
    mesh_order: int = 2

    @property
    def causes(self) -> tuple[str, ...]:
        """Causes of errors that the companion reduces, of `CAUSES`."""
        meshes = self.elements or self.degrees
        refined = self.accuracy[0], self.friction_speeds, meshes, self.inexact
        return tuple(compress(CAUSES, refined))

    def with_steps(self, method: Any) -> Refined:
        """Return the description with the steps of an integrator."""
        return self._replace(accuracy=tuple(method.accuracy), order=method.order)

    def __str__(self) -> str:
        """Describe the companion."""
        if self.method:
            return f"a run with {self.method}"
        texts = []
        if self.elements:
            texts.append(f"halved elements of {list_first(list(self.elements), _MAX_NAMES)}")
        if self.degrees:
            texts.append(f"higher degrees of {list_first(list(self.degrees), _MAX_NAMES)}")
        if self.inexact:
            texts.append("exact strains")
        if self.friction_speeds:
            texts.append("a tenth of the friction speed")
        name, _ = self.accuracy
        if name:
            texts.append("a third of rtol" if name == "rtol" else "short steps of Radau")
        return f"a repetition with {join_names(texts)}" if texts else "nothing is refined"


@read_only_data
@dataclass(frozen=True, repr=False)
class Errors(HasTable):
    """Errors of a result, measured by one repetition in which everything is refined together.

    Attributes
    ----------
    headers
        Headers of the columns with units.
    values, companions
        Headlines of the columns of the result and of its companion (columns,): the largest
        magnitude of a run, a frequency, a load, ...
    total
        Errors of the columns [-]: the change in the companion times 1.15, relative to half the
        range of a column of a run, or to the headline. Not a number if a column is not checked.
    rows
        Largest differences at rows, relative to half the range of the column [-]; not a number
        where a result has no rows.
    refined
        What the companion refines.
    reason
        Why nothing was checked, or empty.
    has_failed
        True if the companion does not reach the end.
    relative_to
        What the errors of each column are relative to, for sentences (columns,).
    has_accuracy
        True if the analysis has an argument `accuracy`.
    _split
        Function that returns `causes`, if there may be several.
    status
        Outcome of a required accuracy: "ok" or "limited", with the largest error and the settings
        that reach it. The sentence is empty if none was required.

    Notes
    -----
    With `accuracy=`, an analysis is repeated, up to five times, with smaller steps, finer meshes
    and exact strains until the errors of the required columns are small enough; `status` says what
    was reached.
    """

    headers: tuple[str, ...]
    values: Array
    companions: Array
    total: Array
    rows: Array
    refined: Refined
    relative_to: tuple[str, ...]
    reason: str = ""
    has_failed: bool = False
    has_accuracy: bool = True
    _split: Callable[[], Mapping[str, Array]] | None = None
    status: Status = UNREQUIRED

    @classmethod
    def unchecked(
        cls, headers: Sequence[str], values: Array, reason: str, has_failed: bool = False
    ) -> Errors:
        """Return the errors of a result that cannot be checked."""
        missing, nothing = np.full(len(headers), np.nan), ("",) * len(headers)
        arrays = values, missing, missing, missing
        return cls(tuple(headers), *arrays, Refined(), nothing, reason, has_failed)

    @classmethod
    def of_values(
        cls,
        headers: Sequence[str],
        values: Array,
        companions: Array,
        refined: Refined,
        scales: Array | None = None,
        relative_to: str = "its value",
    ) -> Errors:
        """Return the errors of single values (columns,), such as frequencies or loads.

        They are relative to `scales` or, by default, to the largest magnitudes of the companion's
        values; `companions` that are not a number have no counterpart. Of several values of a
        column (columns, places), which may be complex, the first one is its headline, and the
        largest change counts.
        """
        places, others = (np.atleast_2d(np.transpose(x)).T for x in (values, companions))
        values, companions = np.real(places[:, 0]), np.real(others[:, 0])
        sizes = np.abs(others).max(axis=1, initial=0.0) if scales is None else np.abs(scales)
        changes = np.abs(places - others)
        changes = np.where(np.isnan(companions), np.nan, np.fmax.reduce(changes, axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            total = np.where(changes == 0.0, 0.0, FACTOR * changes / sizes)
        rows = np.full(len(headers), np.nan)
        of_columns = (relative_to,) * len(headers)
        return cls(tuple(headers), values, companions, total, rows, refined, of_columns)

    @classmethod
    def join(cls, parts: Sequence[Errors]) -> Errors:
        """Return the errors of several results, refined in the same way, as those of one."""

        def collect(name: str) -> Any:
            return np.concatenate([getattr(part, name) for part in parts])

        def split() -> dict[str, Array]:
            return {x: np.concatenate([part.causes[x] for part in parts]) for x in CAUSES}

        return replace(
            parts[0],
            headers=tuple(header for x in parts for header in x.headers),
            relative_to=tuple(text for x in parts for text in x.relative_to),
            reason=next((x.reason for x in parts if x.reason), ""),
            has_failed=any(x.has_failed for x in parts),
            _split=split,
            **{x: collect(x) for x in _ARRAYS},
        )

    def __getstate__(self) -> dict[str, Any]:
        # Functions cannot be pickled; causes that are known are kept.
        return {**vars(self), "_split": None}

    def __repr__(self) -> str:
        is_known = not np.isnan(self.largest)
        worst = f"largest {format_percent(self.largest)}" if is_known else self.reason
        return f"<Errors of {len(self.headers)} columns: {worst}>"

    @property
    def largest(self) -> float:
        """Largest error [-]; not a number if no column was checked."""
        return float(np.fmax.reduce(self.total, initial=np.nan))

    @cached_property
    def causes(self) -> Mapping[str, Array]:
        """Errors by cause (columns,): "time", "friction", "mesh" and "theory" of the strains.

        They add up to the total; errors of different signs compensate each other. If there are
        several causes, the result is repeated with one refinement after the other.
        """
        possible = self.refined.causes
        if len(possible) > 1 and self._split is not None:
            return self._split()
        return {x: self.total if x in possible else np.zeros_like(self.total) for x in CAUSES}

    def table(self) -> pd.DataFrame:
        """Return one row per column of the result.

        Returns
        -------
        pandas.DataFrame
            Indexed by header: "value" and "companion", the headlines [unit of the column]; "rows",
            "total", "time", "friction", "mesh" and "theory", the errors [-]; and "status",
            "measured" (with the beams that are not refined), "not converged" (the companion differs
            by more than the motion itself) or "not checked" with the reason.
        """
        import pandas as pd

        columns: dict[str, Any] = {"value": self.values, "companion": self.companions}
        columns |= {"rows": self.rows, "total": self.total, **self.causes, "status": self.statuses}
        return pd.DataFrame(columns, index=pd.Index(list(self.headers), name="column"))

    def columns(self) -> dict[str, Array]:
        """Return "companion", "total" and "rows" of `table`, and the causes of large errors."""
        columns = {"companion": self.companions, "total": self.total, "rows": self.rows}
        return columns | dict(self.causes) if self.largest > LIMIT else columns

    @property
    def statuses(self) -> list[str]:
        """Status of each column; see `table`."""
        reason = self.reason or "not finite"
        kept = (f"; {name} is not refined: {why}" for name, why in self.refined.kept.items())
        measured = f"measured{''.join(kept)}"
        return [
            f"not checked: {reason}" if np.isnan(x) else "not converged" if x > 1.0 else measured
            for x in self.total
        ]

    def select(self, columns: Collection[str]) -> Errors:
        """Return the errors of some of the columns (headers)."""
        here = np.array([x in columns for x in self.headers], bool)

        def split() -> dict[str, Array]:
            return {cause: errors[here] for cause, errors in self.causes.items()}

        selected = {x: getattr(self, x)[here] for x in _ARRAYS}
        headers = tuple(compress(self.headers, here))
        relative_to = tuple(compress(self.relative_to, here))
        return replace(self, headers=headers, relative_to=relative_to, _split=split, **selected)

    def sentences(self) -> Iterator[str]:
        """Yield a sentence if a required accuracy is not reached, or an error exceeds 4 %."""
        if not self.status.success:
            yield f"accuracy: {self.status.sentence}."
            return
        if self.has_failed:
            yield f"errors: not known, because {self.reason}; check the model, and refine it."
        order = np.argsort(-np.nan_to_num(self.total))
        wrong = [k for k in order.tolist() if self.total[k] > LIMIT]
        if not wrong:
            return
        largest, *others = (
            f"{remove_unit(self.headers[k])}: the error is {_describe(self.total[k])}"
            if k == wrong[0]
            else f"{remove_unit(self.headers[k])} {_format_error(self.total[k])}"
            for k in wrong
        )
        least = AIM * self.total[wrong[0]]
        causes = {x: y[wrong[0]] for x, y in self.causes.items() if abs(y[wrong[0]]) > least}
        parts = ", ".join(
            f"{'less ' if y < 0.0 else ''}{CAUSES[x]} {_format_error(abs(y))}"
            for x, y in sorted(causes.items(), key=lambda cause: -cause[1])
        )
        by = f", by {parts}" if len(causes) > 1 else ""
        of = self.relative_to[wrong[0]]
        text = name_with_others(f"{largest} of {of}{by}", others, _MAX_NAMES)
        advice = self.recommend()
        yield f"{text}, measured by {self.refined}{'; use ' if advice else ''}{advice}."

    def recommend(self, aim: float = AIM) -> str:
        """Return settings that reduce all errors to about `aim` [-], or an empty text."""
        of_cause = {x: float(np.nanmax(np.abs(y), initial=0.0)) for x, y in self.causes.items()}
        needed = {x: y for x, y in of_cause.items() if y > 2.0 * aim}
        texts, refined = [], self.refined
        if "theory" in needed:
            texts.append(f'strain="exact" of {list_first(refined.inexact, _MAX_NAMES)}')
            if needed["theory"] >= of_cause["mesh"]:
                # Meshes of wrong strains do not show the errors of meshes of exact ones.
                needed.pop("mesh", None)
        if "mesh" in needed:
            halvings = int(np.ceil(np.log2(min(needed["mesh"], 1.0) / aim) / refined.mesh_order))
            if self.has_accuracy and (refined.degrees or halvings > _MAX_HALVINGS):
                texts.append(f"accuracy={aim:g}")
                if self.status.sentence:  # The accuracy of other columns was required.
                    wrong = np.flatnonzero(self.total > LIMIT).tolist()
                    columns = [remove_unit(self.headers[k]) for k in wrong]
                    texts.append(f"accuracy_columns={columns}")
                return join_names(texts)
            counts = [f"{2**halvings * x} elements of {y}" for y, x in refined.elements.items()]
            counts += [f"more elements= of {x}" for x in refined.degrees]
            texts.append(list_first(counts, _MAX_NAMES))
        if "friction" in needed:
            names = list_first(refined.friction_speeds, _MAX_NAMES)
            texts.append(f"a friction_speed of {names} ten times smaller")
        if "time" in needed:
            name, value = refined.accuracy
            ratio = aim / min(needed["time"], 1.0)
            ratio **= 1.0 / refined.order if name == "step" else 1.0
            texts.append(f"{name}={ratio * value:.1g}")
        return join_names(texts) if texts else ""


@dataclass(frozen=True, eq=False)
class Split:
    """Repetitions of a result that separate the causes of its errors; see `measure_errors`."""

    result: Any
    companion: Any
    repeat: Callable[[Collection[str]], tuple[Any, Refined]]
    compare: Callable[[Any, Any], Errors]
    failures: tuple[type[Exception], ...]

    @single_threaded
    def __call__(self) -> dict[str, Array]:
        """Return the errors of the columns by cause.

        With the differences d_k of the result and a repetition in which the first k causes are
        refined, and D = d_n of the companion, the errors of cause k are the part of its difference
        along D, (d_k - d_(k-1)) . D / |D|. The products follow from the sizes of the differences:
        2 d_k . D = |d_k|^2 + |D|^2 - |D - d_k|^2.
        """
        whole = self.compare(self.result, self.companion)
        total, possible = whole.total, whole.refined.causes
        shares = {}
        for k, cause in enumerate(possible[:-1], 1):
            try:
                stage, _ = self.repeat(possible[:k])
            except self.failures:
                return dict.fromkeys(CAUSES, np.full_like(total, np.nan))
            before = self.compare(self.result, stage).total
            after = self.compare(stage, self.companion).total
            with np.errstate(divide="ignore", invalid="ignore"):
                share = 0.5 * (1.0 + (before**2 - after**2) / total**2)
            shares[cause] = np.where(total > 0.0, share, 0.0)
            # Small errors of the further causes are not separated.
            if np.nanmax(after, initial=0.0) < min(AIM, np.nanmax(before, initial=0.0)):
                break
        ends = np.array([np.zeros_like(total), *shares.values(), np.ones_like(total)])
        parts = np.diff(ends, axis=0) * total
        causes = dict(zip(possible, parts, strict=False))
        return {x: causes.get(x, np.zeros_like(total)) for x in CAUSES}


class MissingStateError(BeamdaeError):
    """Raised if a refined mechanism has no such state."""


def measure_errors(
    unchecked: Errors,
    result: Any,
    repeat: Callable[[Collection[str]], tuple[Any, Refined]],
    compare: Callable[[Any, Any, Refined], Errors],
    failures: tuple[type[Exception], ...] = (BeamdaeError,),
) -> Errors:
    """Return the errors of a result, measured by one repetition with everything refined together.

    Parameters
    ----------
    unchecked
        Errors if the companion fails; the failure is added to their reason.
    result
        The result, or what is compared of it.
    repeat
        Function that repeats the result with some of `CAUSES` refined, all of them at first, and
        returns it with the description of what was refined.
    compare
        Function that returns the errors of its first argument relative to its second, with the
        description of the companion.
    failures
        Exceptions of repetitions that fail.
    """
    try:
        companion, refined = repeat(CAUSES)
    except failures as problem:
        has_failed = unchecked.has_failed or isinstance(problem, MissingStateError)
        reason = f"{unchecked.reason}: {problem}".rstrip(".")
        return replace(unchecked, reason=reason, has_failed=has_failed)

    def compare_refined(first: Any, second: Any) -> Errors:
        return compare(first, second, refined)

    split = Split(result, companion, repeat, compare_refined, failures)
    errors = compare_refined(result, companion)
    return replace(errors, _split=split)


def _describe(error: float) -> str:
    return f"{'about ' if error <= 1.0 else ''}{_format_error(error)}"


def _format_error(error: float) -> str:
    return format_percent(error) if error <= 1.0 else "more than 100 %"
