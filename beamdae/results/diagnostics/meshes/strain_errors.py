"""Warnings about columns of runs that change with exact strains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from beamdae.errors import format_percent, name_with_others
from beamdae.results.columns import Header, remove_unit
from beamdae.results.diagnostics.meshes.beam_ranges import (
    MAX_UNREPORTED_ERROR,
    find_strain_doubt,
    range_warnings,
)
from beamdae.results.diagnostics.meshes.coarse_elements import (
    UNITS_OF_POSITIONS,
    find_changes,
    scales_of_columns,
)
from beamdae.results.diagnostics.meshes.refined_runs import RunAgain, refine_run
from beamdae.results.run_data import RunData

Array = np.ndarray

# Larger differences of positions may be those of a chaotic motion: it amplifies changes of the
# velocities at the start, here by this share of their largest values. Of 20 runs with such
# differences, two double pendulums amplify them by 2e3 and 7e4, and the others by up to 100.
_LARGE_DIFFERENCE, _START_CHANGE, _MIN_AMPLIFICATION = 0.05, 1e-6, 1e3
_ROUNDED_CHANGE = 1e-3  # of a range; smaller ones are not stated


def strain_error_warnings(run: RunData, run_again: RunAgain | None) -> Iterator[str]:
    """Yield warnings about beams whose strains are beyond their range of validity.

    If an estimated error exceeds 1 %, the run is repeated with exact strains. A warning names the
    columns that differ by over 1 %: positions and angles at any row, relative to their range,
    and the largest magnitudes of other columns. If the run is not repeated or has no such columns,
    the warnings state the estimates.

    Parameters
    ----------
    run
        The run.
    run_again
        Function that repeats the run with other equations, or returns None if it fails; None if
        the run cannot be repeated.
    """
    strained = find_strain_doubt(run.validity)
    if strained is None:
        return
    doubt, names = strained
    exact = None if run_again is None else refine_run(run, run_again, exact=names)
    drawing = _observe_drawing(run)
    scales = _measure_scales(run, drawing)
    finer = {} if exact is None else _measure_scales(exact.run, drawing)
    differences = {} if exact is None else _find_differences(run, exact.run, scales, finer)
    if not differences:
        yield from range_warnings(run.validity)
        return
    values = {header: (0.0, float(np.max(x))) for header, x in differences.items()}
    errors = find_changes(run.equations, values, scales)
    if not errors:
        return
    assert run_again is not None
    assert exact is not None
    worst, *others = errors
    also = [f"{remove_unit(x)} {format_percent(errors[x])}" for x in others]
    name, size, advice = remove_unit(worst), format_percent(errors[worst]), ""
    if _is_position(worst):
        is_large = differences[worst] > MAX_UNREPORTED_ERROR * scales[worst]
        since = run.t[int(np.argmax(is_large))]
        ratio = abs(finer[worst] / scales[worst] - 1.0)
        change = format_percent(ratio) if ratio > _ROUNDED_CHANGE else "less than 0.1 %"
        what = "range from the drawing on" if drawing else "range"
        size = (
            f"up to {size} of its {what}, by over 1 % from t = {since:.4g} s on, and its range by "
            f"{change}"
        )
        if errors[worst] > _LARGE_DIFFERENCE:
            advice = _describe_chaos(run, run_again, worst, scales[worst])
    else:
        name = f"the peak of {name}"
    yield (
        f"{doubt.cause}: {doubt.comparison}, {name} differs by {name_with_others(size, also)}; "
        f"{doubt.remedy(errors[worst])}.{advice}"
    )


def _describe_chaos(run: RunData, run_again: RunAgain, header: str, scale: float) -> str:
    """Return a sentence if the motion amplifies a small change of the start, otherwise ""."""
    e, first = run.equations, run.trajectory.intervals[0].rows
    # Changed positions would excite axial vibrations, which take many steps.
    change = _START_CHANGE * np.max(np.abs(run.v), axis=0)
    other = run_again(replace(e, q0=first.q[0], v0=first.v[0] + change), run.trajectory)
    if other is None:
        return ""
    difference = np.max(_subtract_rows(run, other, header))
    amplification = difference / (scale * _START_CHANGE)
    if not amplification > _MIN_AMPLIFICATION:
        return ""
    return (
        f" The motion is chaotic (changes of the start grow {amplification:.0e} times): compare "
        "ranges instead of values at one time."
    )


def _observe_drawing(run: RunData) -> dict[str, float]:
    """Return the columns of the drawing if the run starts in equilibrium or rotation."""
    e, first = run.equations, run.trajectory.intervals[0]
    if e.start is None or e.start.closed_q is None:
        return {}
    rest = np.zeros((1, e.n))
    state = e.start.closed_q[None], rest, rest, first.rows.lam[:1]
    (values,) = run._observe(first.times[:1], *state)
    return dict(zip(e.observed_headers, values.tolist(), strict=True))


def _measure_scales(run: RunData, drawing: dict[str, float]) -> dict[str, float]:
    """Return ranges of positions and angles, from the drawing on, and peaks of other columns.

    Vibrations about an equilibrium may be smaller than small errors of its deflection.
    """
    extremes = run._extremes_above_rounding
    scales = scales_of_columns(extremes)
    for header in scales:
        if header in drawing and _is_position(header):
            x, drawn = extremes[header], drawing[header]
            scales[header] = max(x.max, drawn) - min(x.min, drawn)
    return scales


def _find_differences(
    run: RunData, other: RunData, scales: dict[str, float], others: dict[str, float]
) -> dict[str, Array]:
    """Return differences at rows, or of the largest magnitude, by header of the column."""
    return {
        header: _subtract_rows(run, other, header)
        if _is_position(header)
        else np.array([abs(scales[header] - others[header])])
        for header in scales
        if header in others
    }


def _is_position(header: str) -> bool:
    return Header.of(header).unit in UNITS_OF_POSITIONS


def _subtract_rows(run: RunData, other: RunData, header: str) -> Array:
    """Return the absolute differences of a column at the rows of both runs."""
    # An event may end one of the runs slightly earlier.
    rows = slice(min(len(run.t), len(other.t)))
    return np.abs(run.columns[header][rows] - other.columns[header][rows])
