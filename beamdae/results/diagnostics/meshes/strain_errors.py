"""Warnings about columns of runs that change with exact strains."""

from __future__ import annotations

from collections.abc import Iterator

from beamdae.results.diagnostics.meshes.beam_ranges import find_strain_doubt, range_warnings
from beamdae.results.diagnostics.meshes.refined_runs import RunAgain, RunChanges, refine_run
from beamdae.results.run_data import RunData


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
    changes = None if exact is None else RunChanges.measure(run, exact.run)
    if run_again is None or changes is None or not changes.differences:
        yield from range_warnings(run.validity)
    else:
        yield from changes.describe(doubt, run_again)
