"""Steps of either kind of method, as rows of a run."""

from __future__ import annotations

from typing import cast

from beamdae.integrators.method import STUCK, LoopMethod, Method, StepError, StepMethod
from beamdae.integrators.rows import Rows

_PAST = "past the end of its interval; a method must stop there"
_STAGES = "a method must give the stages inside a step in the order of time, in every step as many"


def taken(method: Method, rows: Rows, most: int, end: float) -> int:
    """Take up to so many steps, at most to the `end` of the interval; how many they were.

    Raises
    ------
    StepError
        If there is none, or one that does not go ahead or goes past the end.
    """
    if not hasattr(method, "advance"):
        t, state, *inside = cast(StepMethod, method).step()
        _require_ahead(rows, t, end)
        if not rows.append(t, state, *inside):
            raise StepError(_STAGES)
        return 1
    loop = cast(LoopMethod, method)
    found = loop.advance(most)
    _require_ahead(rows, found[-1, 0], end)
    if not rows.extend(found, loop.rows_per_step):
        raise StepError(STUCK)
    return len(found) // loop.rows_per_step


def _require_ahead(rows: Rows, t: float, end: float) -> None:
    if t <= rows.end:
        raise StepError(STUCK)
    if not t <= end:
        raise StepError(f"a step went to t = {t:g} s, {_PAST}")
