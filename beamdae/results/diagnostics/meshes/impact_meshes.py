"""Warnings about peaks after impacts that change with the elements of beams."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.equations.surface_gaps import compile_surface_gaps
from beamdae.errors import format_percent, name_with_others
from beamdae.parts.events import select_impacts
from beamdae.results.columns import UNITS_OF_POSITIONS, Header, format_apart, remove_unit
from beamdae.results.diagnostics.contacts.model_contacts import contacts_of, gaps_of_run
from beamdae.results.diagnostics.meshes.coarse_elements import (
    describe_changes_of_rates,
    doubt_few_elements,
    find_changes,
    headers_of_sections,
    scales_of_columns,
)
from beamdae.results.diagnostics.meshes.refined_runs import (
    find_changes_of_rates,
    find_largest_change,
    remove_drift,
)
from beamdae.results.run_data import RunData

Array = np.ndarray

# Beams with this number of elements or less are compared. In 60 drops of boxes with boards and runs
# of arms that strike stops (1 to 4 elements), changes by halved elements of over 1 % are 0.7 to 1.6
# times the error beside 12 elements for single elements, and 0.8 to 1.1 times for 2 and 3. Later
# peaks are off by up to 75 %. Errors of the largest values are below 2 % with 4 elements.
MAX_ELEMENTS_OF_IMPACTS = 3
_ROUNDING = 1e-9  # of gaps, relative to the length of the mechanism
# Peaks of tenths of the run, at this number of times, with at least this share of the largest
# magnitude, have a warning from this change on.
_TENTHS = 10
_SAMPLES_PER_STEP, _MIN_SAMPLES, _MAX_SAMPLES = 10, 2000, 20_000
_MIN_SHARE_OF_PEAK, _MAX_CHANGE_OF_PEAK = 0.25, 0.05
_MAX_RATIO = 1.5  # of the largest change of such a peak and of the largest value of a column


def has_impacts(run: RunData) -> bool:
    """Return True if an event is an impact, or the gap of a contact closes during the run."""
    e = run.equations
    impacts = {x.name for x in e.events if select_impacts(x.do)}
    if any(x.name in impacts for x in run.event_records):
        return True
    contacts, least = contacts_of(e), _ROUNDING * e.length
    for gap in compile_surface_gaps(e) if contacts else ():
        values = gaps_of_run(gap, run.trajectory) if gap.part in contacts else np.zeros(0)
        is_open, is_closed = values > least, values < -least
        if is_open.any() and is_closed[int(np.argmax(is_open)) :].any():
            return True
    return False


def describe_impacts(run: RunData, other: RunData, beams: Sequence[Beam]) -> Iterator[str]:
    """Yield a warning if peaks of a run with impacts change with halved elements.

    Impacts excite vibrations of which a single element, or a few, do not follow the first ones
    well: the largest values of columns change by over 1 %, and later peaks of stresses, strains and
    section forces by tens of percent.

    Parameters
    ----------
    run
        The run.
    other
        The run with halved elements.
    beams
        The beams whose elements are halved; the first one has the fewest.
    """
    e = run.equations
    scales = scales_of_columns(run._extremes_above_rounding)
    finer = scales_of_columns(other._extremes_above_rounding)
    values = {x: (scales[x], finer[x]) for x in scales if x in finer}
    errors = find_changes(e, values, scales, mechanism=run._sizes_of_mechanism)
    errors = remove_drift(run, other, errors, scales)
    clauses = []
    if errors:
        worst, *others = errors
        one, another = format_apart(worst, values[worst][1], values[worst][0])
        also = [f"{remove_unit(x)} {format_percent(errors[x])}" for x in others]
        change = name_with_others(format_percent(errors[worst]), also)
        what = "range" if Header.of(worst).unit in UNITS_OF_POSITIONS else "peak"
        clauses.append(
            f"the {what} of {remove_unit(worst)} is {one} instead of {another}, a change of "
            f"{change}"
        )
    rate_errors = find_changes_of_rates(run, other)
    if rate_errors:
        clauses.append(describe_changes_of_rates(rate_errors))
    later = _find_later_change(run, other, scales)
    if later is not None:
        header, start, end, largest = later
        if largest > _MAX_RATIO * max(errors.values(), default=0.0):
            clauses.append(
                f"the peak of {remove_unit(header)} between t = {start:.4g} and {end:.4g} s "
                f"changes by {format_percent(largest)}"
            )
    if not clauses:
        return
    doubt = doubt_few_elements(beams)
    yield (
        f"{doubt.cause} for this impact: {doubt.comparison}, {', and '.join(clauses)}; "
        f"{doubt.remedy(find_largest_change(errors, rate_errors))}."
    )


def _find_later_change(
    run: RunData, other: RunData, scales: Mapping[str, float]
) -> tuple[str, float, float, float] | None:
    """Return the header, the times [s] and the change of the peak of a tenth that changes most.

    Peaks are those of stresses, strains and section forces. None if all changes are small.
    """
    e = run.equations
    of_sections = headers_of_sections(e)
    headers = [x for x in scales if x in of_sections]
    start = run.trajectory.start
    end = min(run.trajectory.end, other.trajectory.end)
    if not headers:
        return None
    count = _SAMPLES_PER_STEP * run.trajectory.steps
    count = min(max(count, _MIN_SAMPLES), _MAX_SAMPLES) // _TENTHS
    times = np.linspace(start, end, _TENTHS * count)
    columns = [e.observed_headers.index(x) for x in headers]
    peaks, finer = (
        np.max(np.abs(x._observe_at(times)[:, columns]).reshape(_TENTHS, count, -1), axis=1)
        for x in (run, other)
    )
    sizes = np.array([scales[x] for x in headers])
    largest = np.maximum(peaks, finer)
    is_large = largest > _MIN_SHARE_OF_PEAK * sizes
    changes = np.where(is_large, np.abs(peaks - finer) / np.where(is_large, largest, 1.0), 0.0)
    k, column = map(int, np.unravel_index(np.argmax(changes), changes.shape))
    if changes[k, column] <= _MAX_CHANGE_OF_PEAK:
        return None
    bounds = np.linspace(start, end, _TENTHS + 1)
    return headers[column], float(bounds[k]), float(bounds[k + 1]), float(changes[k, column])
