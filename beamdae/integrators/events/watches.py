"""Watches of the contacts and tables of a mechanism."""

from __future__ import annotations

from collections.abc import Sequence

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import compile_surface_gaps
from beamdae.equations.table_arguments import TableArgumentTerm, find_distinct, group_grids
from beamdae.integrators.events.stop import Watch


def watch_tables_and_contacts(
    equations: EquationsOfMotion, arguments: Sequence[TableArgumentTerm], is_adaptive: bool
) -> tuple[Watch, ...]:
    """Return the watches of the contacts of all parts and of the `arguments` of tables.

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
