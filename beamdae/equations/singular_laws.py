"""Laws of time that become infinite within a run, between two steps for all an integrator knows."""

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
from beamdae.symbolic.compiled import RowFunction
from beamdae.symbolic.formulas import MAX_SHARED_KERNELS, Formula

Array = np.ndarray

# Looks at a law in an interval, and around each of its peaks: so many times over, each time in the
# quarter of the stretch around the largest value.
_LOOKS, _INTO, _TIMES = 501, 9, 13
# Around a pole of order p values grow by 1024^p from the far to the near distance; a peak has been
# seen whole from afar. Distances in widths between looks.
_FAR, _NEAR, _GROWTH = 4.0**-6, 4.0**-11, 16.0


class PartLaw(NamedTuple):
    """A law that changes with time, a function of (t, branch) and its numbers, and its part."""

    part: str
    function: RowFunction
    numbers: Array

    def size(self, times: Array, branches: Array) -> Array:
        """Size of its values at rows of times [s], each on its branch; that of no number is 0."""
        rows = np.stack(np.broadcast_arrays(times, branches[:, None]), axis=-1).reshape(-1, 2)
        sizes = np.abs(self.function(rows, self.numbers)).reshape(times.shape)
        return np.where(np.isnan(sizes), 0.0, sizes)


def collect_varying_laws(parts: Iterable[Part | GravityLaws]) -> tuple[PartLaw, ...]:
    """The laws of the parts that change with time, each once."""
    return select_varying_laws((part.name, law) for part in parts for law in part.laws)


def select_varying_laws(laws: Iterable[tuple[str, Law]]) -> tuple[PartLaw, ...]:
    """Those of laws, each with the name of what follows it, that change with time, each once."""
    found: dict[int, PartLaw] = {}
    for part, law in laws:
        if id(law) in found:
            continue
        formula, numbers = law.formula, np.zeros(0)
        if isinstance(formula, Formula):
            numbers = np.array(formula.numbers, float)
            function = _compile_varying_kind(formula.kind, len(numbers))
        else:
            function = _compile_varying_law(formula, ca.SX(0, 1))
        if function is not None:
            found[id(law)] = PartLaw(part, function, numbers)
    return tuple(found.values())


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _compile_varying_kind(kind: Callable[..., Any], count: int) -> RowFunction | None:
    numbers = ca.SX.sym("numbers", count)
    return _compile_varying_law(Formula(kind, numbers), numbers)


def _compile_varying_law(law: Callable[[ca.SX], ca.SX], numbers: ca.SX) -> RowFunction | None:
    """(t, branch) and numbers -> the law, if it changes with time."""
    time = ca.SX.sym("t", 2)
    value = law(time)
    if not ca.depends_on(value, time):
        return None
    return RowFunction(ca.Function("law", [time, numbers], [ca.densify(value)]))


def require_no_pole(laws: Iterable[PartLaw], intervals: Sequence[tuple[float, float]]) -> None:
    """Refuse laws that become infinite in one of the intervals of a run.

    Steps over a pole give an answer, and no error test sees what is wrong with it.

    Raises
    ------
    BeamdaeError
        Naming the part and the time.
    """
    for law in laws:
        pole = _find_pole(law, np.array(intervals))
        if pole is not None:
            raise BeamdaeError(
                f"{law.part}: its law becomes infinite near t = {pole:.6g} s, it must be finite "
                f"from t = {intervals[0][0]:g} s to {intervals[-1][1]:g} s."
            )


def _find_pole(law: PartLaw, intervals: Array) -> float | None:
    """A time at which a law is infinite, if one is found: one that stands out among the looks."""
    start, end = intervals.T
    size = law.size(np.linspace(start, end, _LOOKS, axis=1), 0.5 * (start + end))
    beside, before = np.zeros_like(size), np.zeros_like(size)
    beside[:, :-1], before[:, 1:] = size[:, 1:], size[:, :-1]
    peak = (size >= before) & (size >= beside) & ((size > before) | (size > beside))
    interval, look = np.nonzero(peak)
    if not len(look):
        return None
    # A look may be right on the pole, as near to it as rounding is.
    others = size[interval]
    others[np.arange(len(look)), look] = 0.0
    most = others.max(axis=1)
    start, end = start[interval], end[interval]
    width = (end - start) / (_LOOKS - 1)
    at = start + look * width

    def around(distances: Array) -> tuple[Array, Array]:
        looks = at[:, None] + width[:, None] * distances
        looks = np.clip(looks, start[:, None], end[:, None])
        return looks, law.size(looks, 0.5 * (start + end))

    for k in range(_TIMES):
        looks, sizes = around(0.25**k * np.linspace(-1.0, 1.0, _INTO))
        at = np.take_along_axis(looks, np.argmax(sizes, axis=1)[:, None], axis=1).ravel()
    ends = np.array([-1.0, 1.0])
    far, near = (around(distance * ends)[1].max(axis=1) for distance in (_FAR, _NEAR))
    # Rounding grows by any factor from next to nothing, but not beyond what the law is elsewhere.
    grows = (near > _GROWTH * far) & (near >= most)
    (found,) = np.nonzero(np.isinf(sizes).any(axis=1) | grows)
    return float(at[found[0]]) if len(found) else None
