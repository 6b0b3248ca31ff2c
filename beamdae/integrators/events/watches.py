"""What ends a run, or a step early, although the error test accepts the step.

A watch examines the rows of new steps: arguments that leave tables, contacts and peaks that steps
pass over, and events. The run ends at its first stop, or restarts there, after the actions of an
event, or where the error test sees what the step has passed over.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, EventTerm
from beamdae.equations.formula_forces import compile_formula_forces
from beamdae.equations.surface_gaps import compile_surface_gaps
from beamdae.equations.table_arguments import (
    TableArgumentTerm,
    find_distinct,
    group_grids,
)
from beamdae.integrators.run_plan import RunPlan
from beamdae.integrators.step_history import RunSegment

Array = np.ndarray

_ROUNDING = 4.0 * float(np.finfo(float).eps)


class Stop(NamedTuple):
    """Time at which a step must end.

    Attributes
    ----------
    t
        The time [s].
    probe
        Time [s] inside the contact or peak that begins at `t`, at which the first step after the
        restart ends at the latest.
    reason
        Reason why the run ends at `t`; empty if it restarts there.
    force
        Name of the force that has a peak; empty for other stops.
    event
        Event at `t`; None for other stops.
    """

    t: float
    probe: float
    reason: str = ""
    force: str = ""
    event: EventTerm | None = None


class Watch(Protocol):
    """Search of the steps for times at which they must end."""

    def find_first(self, segment: RunSegment, row: int) -> Stop | None:
        """Return the first stop in the rows of a segment from `row` on, or None."""


def create_watches(
    equations: EquationsOfMotion, arguments: Sequence[TableArgumentTerm], is_adaptive: bool
) -> tuple[Watch, ...]:
    """Return the watches of the contacts of all parts, and of the `arguments` of tables.

    Peaks of tables are searched if `is_adaptive` is True.
    """
    # Imported where they are created: most models have no surfaces and tables.
    watches: list[Watch] = []
    if gaps := compile_surface_gaps(equations):
        from beamdae.integrators.events.contact_onsets import ContactWatch

        watches.append(ContactWatch(gaps, equations.length))
    distinct = find_distinct(arguments)
    limited = [term for term in distinct if term.is_limited]
    calls = [(term,) for term in distinct if len(term.constants) == 1] if is_adaptive else []
    if limited or calls or (is_adaptive and arguments):
        from beamdae.integrators.events.table_limits import TableWatch

        grids = group_grids(arguments) if is_adaptive else ()
        watches.append(TableWatch(limited, [*calls, *grids]))
    return tuple(watches)


def watch_forces(plan: RunPlan, rtol: float) -> tuple[Watch, ...]:
    """Return the watch of the peaks of formulas of the active parts, if there are any."""
    terms = compile_formula_forces(plan.equations)
    if not terms:
        return ()
    from beamdae.integrators.events.force_peaks import create_force_watch

    return (create_force_watch(terms, plan, rtol),)


def locate_root(
    evaluate: Callable[[Array], Array], start: float, end: float, rtol: float = _ROUNDING
) -> float:
    """Return the time [s] between two times at which a function of times changes its sign."""
    # Imported here because the import takes as long as a short run.
    from scipy.optimize import brentq

    return float(brentq(lambda t: float(evaluate(np.array([t]))[0]), start, end, rtol=rtol))
