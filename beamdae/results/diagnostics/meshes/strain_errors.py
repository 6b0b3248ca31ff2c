"""Warnings about columns of runs that change with exact strains."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.beams.dispersion import section_values
from beamdae.results.diagnostics.meshes.beam_ranges import (
    find_strain_doubt,
    range_warnings,
    sample_positions,
)
from beamdae.results.diagnostics.meshes.coarse_elements import evaluate_forces
from beamdae.results.diagnostics.meshes.refined_runs import RunAgain, RunChanges, refine_run
from beamdae.results.run_data import RunData

# Estimated errors from which on runs of strongly compressed beams are compared: near the buckling
# load, deflections change by a multiple. A rod at 97 % of its Euler load had an estimate of 0.8 %
# and an error of 3.8 %.
_MIN_ERROR_NEAR_BUCKLING = 1e-3
# Compression of such beams, relative to the Euler load of hinged ends; cantilevers buckle at 0.25.
_LARGE_COMPRESSION = 0.2
_MAX_ROWS = 400


def strain_error_warnings(run: RunData, run_again: RunAgain | None) -> Iterator[str]:
    """Yield warnings about beams whose strains are beyond their range of validity.

    If an estimated error exceeds 1 %, or a tenth of this near a buckling load, the run is repeated
    with exact strains. A warning names the columns that differ by over 1 %: positions and angles at
    any row, relative to their range, and the largest magnitudes of other columns. If the run is not
    repeated or has no such columns, the warnings state the estimates.

    Parameters
    ----------
    run
        The run.
    run_again
        Function that repeats the run with other equations, or returns None if it fails; None if
        the run cannot be repeated.
    """
    strained = find_strain_doubt(run.validity)
    if strained is None and run_again is not None:
        smaller = find_strain_doubt(run.validity, _MIN_ERROR_NEAR_BUCKLING)
        strained = smaller if smaller and _are_compressed(run) else None
    if strained is None:
        return
    doubt, names = strained
    exact = None if run_again is None else refine_run(run, run_again, exact=names)
    changes = None if exact is None else RunChanges.measure(run, exact.run)
    if run_again is None or changes is None or not changes.differences:
        yield from range_warnings(run.validity)
    else:
        yield from changes.describe(doubt, run_again)


def _are_compressed(run: RunData) -> bool:
    """Return True if a beam is compressed by a large part of its Euler load."""
    q = sample_positions(run.trajectory)
    for beam, forces in evaluate_forces(run.equations, q[:: len(q) // _MAX_ROWS + 1]):
        (bending,) = section_values(beam, "EI")
        euler_load = np.pi**2 * np.min(bending) / beam.length**2
        if -np.min(forces[..., 0]) > _LARGE_COMPRESSION * euler_load:
            return True
    return False
