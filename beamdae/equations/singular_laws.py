"""Detection of time laws that become infinite within a run, possibly between two steps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.parts.gravity import GravityLaws
from beamdae.parts.laws import Law
from beamdae.parts.part import Part
from beamdae.symbolic.formula import MAX_SHARED_KERNELS, Formula
from beamdae.symbolic.functions.compiled import RowFunction
from beamdae.symbolic.signals import with_references

Array = np.ndarray

# Search for peaks: samples of an interval, then of ever smaller ranges around each peak, which
# shrink by the ratio in every refinement.
_N_SAMPLES = 501
_N_REFINED_SAMPLES = 9
_N_REFINEMENTS = 13
_REFINEMENT_RATIO = 0.25
# Around a pole of order p, values grow by 1024^p from the far to the near distance; a finite peak
# is already resolved at the far distance. Distances are in sample widths.
_FAR_DISTANCE = 4.0**-6
_NEAR_DISTANCE = 4.0**-11
_POLE_GROWTH = 16.0
# Operations that are finite at all finite operands, but for tanh, whose products are short pulses.
_FINITE_OPERATIONS = frozenset(
    getattr(ca, f"OP_{name}")
    for name in (
        *("ASSIGN", "ADD", "SUB", "MUL", "NEG", "TWICE", "SQ", "SIN", "COS", "ATAN"),
        *("FABS", "FMIN", "FMAX", "LT", "LE", "EQ", "NE", "NOT", "AND", "OR", "IF_ELSE_ZERO"),
        # Lookups in tables.
        "CALL",
    )
)


class PartLaw(NamedTuple):
    """Law that depends on time and may become infinite.

    Attributes
    ----------
    part
        Name of the part or, in a constrained system, of the symbol.
    function
        Function of rows of (t, branch) and of `numbers`.
    numbers
        Numbers in the law, (k,).
    """

    part: str
    function: RowFunction
    numbers: Array

    def values(self, times: Array, branches: Array) -> Array:
        """Return the law at each of `times` [s], with one branch time per row."""
        rows = np.empty((*times.shape, 2))
        rows[..., 0], rows[..., 1] = times, branches[:, None]
        return np.reshape(self.function(rows.reshape(-1, 2), self.numbers), times.shape)

    def size(self, times: Array, branches: Array) -> Array:
        """Return |law| at each of `times` [s], with one branch time per row; nan becomes 0."""
        sizes = np.abs(self.values(times, branches))
        return np.where(np.isnan(sizes), 0.0, sizes)


def collect_unbounded_laws(parts: Iterable[Part | GravityLaws]) -> tuple[PartLaw, ...]:
    """Return the laws of parts and of gravity that may become infinite, each law once."""
    return select_unbounded_laws((part.name, law) for part in parts for law in part.laws)


def select_unbounded_laws(laws: Iterable[tuple[str, Law]]) -> tuple[PartLaw, ...]:
    """Return those laws of pairs (name of the part, law) that may become infinite, each once."""
    part_laws: dict[int, PartLaw] = {}
    for part, law in laws:
        if id(law) in part_laws:
            continue
        formula, numbers = law.formula, np.zeros(0)
        if isinstance(formula, Formula):
            numbers = np.array(formula.numbers, float)
            function = _compile_kind(formula.kind, len(numbers))
        else:
            function = _compile_law(formula, ca.SX(0, 1))
        if function is not None:
            part_laws[id(law)] = PartLaw(part, function, numbers)
    return tuple(part_laws.values())


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _compile_kind(kind: Callable[..., Any], count: int) -> RowFunction | None:
    numbers = ca.SX.sym("numbers", count)
    return _compile_law(Formula(kind, numbers), numbers)


def _compile_law(law: Callable[[ca.SX], ca.SX], numbers: ca.SX) -> RowFunction | None:
    """Compile a law as a function of (t, branch) and numbers; None if it is always finite."""
    time = ca.SX.sym("t", 2)
    function = ca.Function("law", [time, numbers], [ca.densify(with_references(law(time)))])
    return RowFunction(function) if _may_become_infinite(function) else None


def _may_become_infinite(function: ca.Function) -> bool:
    """Return True if operations on time, the first input, may be infinite at a finite time."""
    depends_on_time = [False] * function.sz_w()
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        operands, results = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_OUTPUT:
            continue
        if code in (ca.OP_INPUT, ca.OP_CONST):
            depends = code == ca.OP_INPUT and operands[0] == 0
        else:
            depends = any(depends_on_time[i] for i in operands)
            is_division_by_number = code == ca.OP_DIV and not depends_on_time[operands[1]]
            if depends and code not in _FINITE_OPERATIONS and not is_division_by_number:
                return True
        for result in results:
            depends_on_time[result] = depends
    return False


def require_no_pole(laws: Iterable[PartLaw], intervals: Sequence[tuple[float, float]]) -> None:
    """Reject laws that become infinite in one of the intervals (start, end) [s] of a run.

    Without this check, integrators may step over a pole.

    Raises
    ------
    BeamdaeError
        If a pole is found; the message names the part and the time.
    """
    for law in laws:
        pole = _find_pole(law, np.array(intervals))
        if pole is not None:
            raise BeamdaeError(
                f"{law.part}: the law becomes infinite near t = {pole:.6g} s; laws "
                f"must be finite from t = {intervals[0][0]:g} s to "
                f"{intervals[-1][1]:g} s."
            )


def _find_pole(law: PartLaw, intervals: Array) -> float | None:
    """Return a time [s] near which a law becomes infinite, or None.

    Only the peaks of equidistant samples are examined.
    """
    start, end = intervals.T
    size = law.size(np.linspace(start, end, _N_SAMPLES, axis=1), 0.5 * (start + end))
    following, preceding = np.zeros_like(size), np.zeros_like(size)
    following[:, :-1], preceding[:, 1:] = size[:, 1:], size[:, :-1]
    is_peak = (size >= preceding) & (size >= following)
    is_peak &= (size > preceding) | (size > following)
    interval, sample = np.nonzero(is_peak)
    if not len(sample):
        return None
    # A sample may lie on the pole up to rounding, so compare with the other samples.
    others = size[interval]
    others[np.arange(len(sample)), sample] = 0.0
    largest_elsewhere = others.max(axis=1)
    start, end = start[interval], end[interval]
    width = (end - start) / (_N_SAMPLES - 1)
    peak = start + sample * width

    def sample_around(distances: Array) -> tuple[Array, Array]:
        times = peak[:, None] + width[:, None] * distances
        times = np.clip(times, start[:, None], end[:, None])
        return times, law.size(times, 0.5 * (start + end))

    for k in range(_N_REFINEMENTS):
        distances = _REFINEMENT_RATIO**k * np.linspace(-1.0, 1.0, _N_REFINED_SAMPLES)
        times, sizes = sample_around(distances)
        peak = np.take_along_axis(times, np.argmax(sizes, axis=1)[:, None], axis=1).ravel()
    both_sides = np.array([-1.0, 1.0])
    far, near = (
        sample_around(distance * both_sides)[1].max(axis=1)
        for distance in (_FAR_DISTANCE, _NEAR_DISTANCE)
    )
    # Rounding errors near zero can also grow by this factor, but stay below the rest of the law.
    grows = (near > _POLE_GROWTH * far) & (near >= largest_elsewhere)
    (poles,) = np.nonzero(np.isinf(sizes).any(axis=1) | grows)
    return float(peak[poles[0]]) if len(poles) else None
