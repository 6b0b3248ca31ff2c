"""Warnings about columns of runs that change with halved elements.

Runs with beams of one or two elements are repeated with halved ones. If they are long, or the
elements of beams with more elements are long for their tension, one state is compared: a quasi-
static motion with the same accelerations, see `coarse_elements`, and the lowest natural frequency
at this instant, unless the elements are few and straight: near a resonance, its small error changes
the motion by a multiple of it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import NamedTuple

import numpy as np

from beamdae import deferred
from beamdae.beams.beam import Beam, beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.measures import ObservedRows
from beamdae.errors import BeamdaeError
from beamdae.results.diagnostics.meshes.coarse_elements import (
    LARGE_CHANGE,
    describe_changes,
    doubt_few_elements,
    find_few_elements,
    find_refined_instant,
    find_taut_beams,
    headers_of_sections,
    pair_frequencies,
    sample_instants,
    scales_of_columns,
)
from beamdae.results.diagnostics.meshes.impact_meshes import (
    MAX_ELEMENTS_OF_IMPACTS,
    describe_impacts,
    has_impacts,
)
from beamdae.results.diagnostics.meshes.moving_loads import measured_quantity
from beamdae.results.diagnostics.meshes.refined_runs import (
    RunAgain,
    RunChanges,
    is_short,
    refine_run,
)
from beamdae.results.run_data import RunData
from beamdae.results.trajectory import Instant

Array = np.ndarray

# Beams with this number of elements or less are compared. In 77 runs beside 8 elements, 57 stated
# changes are 0.8 to 1.1 times the error; errors with two elements are up to 9 %.
_FEW_ELEMENTS = 2
# Turn of an element [rad] from which on an instant of a long run is compared.
_LARGE_TURN = 0.1
_MODES = 10  # of which the slowest vibration is compared


class ElementErrors(NamedTuple):
    """Comparison of a run with halved elements.

    Attributes
    ----------
    beams
        Names of the beams with halved elements.
    columns
        Headers of the columns whose errors by the elements of all beams are known, and are small.
    warnings
        Sentences about columns that change.
    has_hard_impacts
        True if forces rise faster than the elements resolve, but not faster than halved ones do.
    """

    beams: tuple[str, ...] = ()
    columns: frozenset[str] = frozenset()
    warnings: tuple[str, ...] = ()
    has_hard_impacts: bool = False


def compare_few_elements(
    run: RunData,
    run_again: RunAgain,
    is_complete: bool,
    find_wrong_sections: Callable[[], Collection[str]],
) -> ElementErrors:
    """Repeat a short run with halved elements of beams with few.

    Of runs with impacts, these are beams of up to three elements, and ranges and peaks are
    compared. Otherwise, these are beams of up to two elements, and positions and angles are
    compared at all rows, and peaks of other columns, also of rates and accelerations.

    Parameters
    ----------
    run
        The run.
    run_again
        Function that repeats the run with other equations, or returns None if it fails.
    is_complete
        True if the run reaches its planned end. Otherwise, impacts are not compared.
    find_wrong_sections
        Function that returns the headers of stresses, strains and section forces that differ from
        those in equilibrium with the loads. Their changes are not named a second time.
    """
    e = run.equations
    beams = sorted(beams_of(e.mechanism), key=lambda x: x.mesh.elements)
    few = [x for x in beams if x.mesh.elements <= MAX_ELEMENTS_OF_IMPACTS]
    if not few or not is_short(run):
        return ElementErrors()
    strikes = has_impacts(run)
    few = [x for x in few if strikes or x.mesh.elements <= _FEW_ELEMENTS]
    if not few or (strikes and not is_complete):
        return ElementErrors()
    finer = refine_run(run, run_again, halved=[x.name for x in few])
    if finer is None:
        return ElementErrors()
    if finer.run._hard_impacts:
        # Halved elements do not resolve the rise, either; see `hard_impacts` for the estimate.
        return ElementErrors()
    few, is_hard = [x for x in few if x.name in finer.halved], bool(run._hard_impacts)
    if strikes:
        warnings = tuple(describe_impacts(run, finer.run, few))
        return ElementErrors(finer.halved, warnings=warnings, has_hard_impacts=is_hard)
    positions = np.array([x.state.q for x in sample_instants(run.trajectory)])
    taut = [x for x in find_taut_beams(e, positions) if x.name in finer.halved]
    changes = RunChanges.measure(run, finer.run)
    doubt = taut[0] if taut else doubt_few_elements(few)
    warnings = tuple(changes.describe(doubt, run_again, find_wrong_sections()))
    known = _known_columns(run, changes) if len(few) == len(beams) else frozenset()
    return ElementErrors(finer.halved, known, warnings, is_hard)


def _known_columns(run: RunData, changes: RunChanges) -> frozenset[str]:
    """Return the headers of columns with small changes, and of rates of such positions.

    Large changes may differ from the error: halved elements are not accurate, either.
    """
    errors = changes.errors | changes.rate_errors
    large = {header for header, error in errors.items() if error >= LARGE_CHANGE}
    return frozenset(x for x in run.columns if x not in large and _position_of(x) not in large)


def _position_of(header: str) -> str:
    """Return the header of the position of a rate, and other headers unchanged."""
    return header.replace("_dot [", " [").replace("/s]", "]")


def instant_warnings(
    run: RunData, run_again: RunAgain | None, compared: Collection[str] = ()
) -> Iterator[str]:
    """Yield a warning if columns at an instant change by over 1 % with halved elements.

    The state with the elements that are longest for their tension is examined or, if a beam has
    few elements that are curved or contain observed motions, that with its largest bending moment.
    If there is no such state with halved elements, as while a beam snaps, a run with long elements
    is repeated.

    Parameters
    ----------
    run
        The run.
    run_again
        Function that repeats the run with other equations, or returns None if it fails; None if
        the run cannot be repeated.
    compared
        Names of beams to leave out.
    """
    equations, trajectory = run.equations, run.trajectory
    duration = trajectory.end - trajectory.start
    if not duration > 0.0:
        return
    instants = sample_instants(trajectory)
    positions = np.array([x.state.q for x in instants])
    others = [x for x in beams_of(equations.mechanism) if x.name not in compared]
    few = [x for x in others if x.mesh.elements <= _FEW_ELEMENTS]
    curved = {x.name for x in few if x.mesh.largest_turn >= _LARGE_TURN}
    observed = {x.name for x in few if _observes_within_elements(equations, x)}
    taut = [x for x in find_taut_beams(equations, positions) if x.name not in compared]
    doubt = taut[0] if taut else find_few_elements(equations, positions, curved | observed)
    if doubt is None:
        return
    # Imported here because few runs need it, and the import slows the start of the others.
    from beamdae.equations.assembly.refined_beams import refine_beams

    halved = refine_beams(equations)
    if halved is None:
        return
    coarse = instants[doubt.row]
    fine = find_refined_instant(equations, halved, coarse, duration)
    if fine is None:
        finer = run_again and refine_run(run, run_again, halved=[x.name for x in taut])
        if run_again and finer:
            changes = RunChanges.measure(run, finer.run)
            yield from changes.describe(doubt, run_again, headers_of_sections(equations))
        return
    scales = scales_of_columns(run._extremes_above_rounding)
    pairs = (equations, coarse), (halved.equations, fine)
    rows = zip(*(_observe(*pair) for pair in pairs), strict=True)
    values = dict(zip(equations.observed_headers, rows, strict=True))
    if taut or doubt.name in curved:
        before, after = (_find_eigenvalues(*pair) for pair in pairs)
        frequencies = pair_frequencies(before, after, least=1.0 / duration)
        scales |= {name: x[0] for name, x in frequencies.items()}
        values |= frequencies
    when, omitted = f" at t = {coarse.t:.4g} s", headers_of_sections(equations)
    yield from describe_changes(
        equations, doubt, values, scales, when, omitted=omitted, mechanism=run._sizes_of_mechanism
    )


def _observes_within_elements(equations: EquationsOfMotion, beam: Beam) -> bool:
    """Return True if a motion between the ends of an element is observed."""
    mechanism = equations.mechanism
    observed = () if mechanism is None else mechanism.observables.values()
    sections = (s for x in observed for s in beam.sections_of_motion(measured_quantity(x)[0]))
    return not all(map(beam.mesh.has_end_at, sections))


def _observe(equations: EquationsOfMotion, instant: Instant) -> list[float]:
    """Return the observed columns."""
    observe = ObservedRows(equations.with_loads_of(instant.configuration))
    row = observe(instant.time[None], *(x[None] for x in instant.state))[0]
    return list(map(float, row))


def _find_eigenvalues(equations: EquationsOfMotion, instant: Instant) -> Array:
    """Return the smallest eigenvalues of the frozen motion [1/s], or none if there are none."""
    natural_modes = deferred.module("analysis.linear_dynamics.natural_modes")
    try:
        return np.asarray(natural_modes.compute_modes(equations, instant, _MODES).eigenvalues)
    except BeamdaeError:
        return np.zeros(0)
