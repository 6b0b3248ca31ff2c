"""Errors of periodic motions by the strains and the elements of beams.

Near a resonance, a small error of the stiffness changes the motion by a multiple of it: an error of
0.1 % of the frequency changes the amplitude by up to 10 % at a damping ratio of 0.5 %. Estimates
for single beams do not include this. Therefore, Newton's method finds the same motion of the model
with exact strains and, if waves are short for the elements or these are few, or long for the
tension, with halved elements. It begins with the monodromy matrix of the first motion.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.periodic.monodromy import LinearizationError
from beamdae.analysis.periodic.shooting import (
    IncompleteRunError,
    Linearization,
    PeriodMap,
    PeriodRun,
    Tolerance,
    solve_shooting,
)
from beamdae.beams.beam import beams_of
from beamdae.beams.dispersion import bending_wave_errors
from beamdae.equations.assembly.refined_beams import RefinedBeams, refine_beams
from beamdae.integrators import Radau
from beamdae.results.columns import (
    UNITS_OF_POSITIONS,
    Header,
    mark_resting_columns,
    mark_unresolved_columns,
    mark_vanishing_columns,
)
from beamdae.results.diagnostics.meshes.coarse_elements import find_taut_beams, sample_instants
from beamdae.results.periodic_motion import BeamError
from beamdae.results.run_data import find_drift

Array = np.ndarray

# Tolerance of the compared motions, relative to the amplitudes: a tenth of the errors that are
# reported. Corrections are ten times smaller.
_TOLERANCE = Tolerance(1e-3, 1e-2)
# The search ends if it leaves the first motion by more than this in a step, relative to the
# amplitudes: it would not find a motion close to it, and runs with large deformations take long.
_MAX_DIFFERENCE = 1.0
# Elements are halved if their estimated effect on the motion exceeds this value.
_MIN_MESH_ERROR = 3e-3
# Elements of beams with this number or less are halved in forced motions: near a buckling load,
# they are too stiff for motions whose waves are long.
_FEW_ELEMENTS = 2
# Relative tolerance of the compared runs, relative to the distance of the multipliers from 1, which
# amplifies their errors. Errors of a run are up to 60 times its tolerance: 0.2 % of the motion.
_RTOL_RATIO = 3e-5
_MAX_RTOL = 1e-6
_TINY = 1e-300  # prevents a division by zero


@dataclass(frozen=True, eq=False)
class _TransferredLinearization(Linearization):
    """Newton's matrix of a motion for a model with finer elements.

    Attributes
    ----------
    prolongation
        Matrix from states (q, v) of the model to those with finer elements, (2 n', 2 n).
    """

    prolongation: Array

    def update(self, last: PeriodRun, run: PeriodRun) -> Linearization:
        """Return this linearization: the matrix has other motions than the runs."""
        return self

    def newton_step(self, run: PeriodRun, largest: float) -> tuple[Array, float, float]:
        """Return the changes of (q, v), (2 n',), and of the period, and their share.

        Motions that the model does not have are those of short waves; they are left to the run.
        """
        deviation = run.period_map.deviation(run.solution)
        coarse = np.linalg.lstsq(self.prolongation, deviation, rcond=None)[0]
        change, stretch = self.solve(coarse)
        return self.limit(run, largest, self.prolongation @ (change - coarse) + deviation, stretch)


class BeamErrorEstimator:
    """Errors of periodic motions by strains and elements, for the motions along a curve in turn.

    The search for each more accurate motion begins at the difference of the last one.
    """

    def __init__(self) -> None:
        self._difference = np.zeros(0)

    def measure(
        self, run: PeriodRun, monodromy: Array, free_period: bool = False
    ) -> BeamError | None:
        """Return the errors of the columns of a motion.

        Parameters
        ----------
        run
            The motion.
        monodromy
            Its monodromy matrix.
        free_period
            True if the period is an unknown.

        Returns
        -------
        BeamError or None
            None if no beam can be replaced, or there are no columns.
        """
        distance = _distance_from_resonance(monodromy, free_period)
        reference = _build_reference(run, _find_coarse_beams(run, distance, free_period))
        if reference is None or not run.solution.columns:
            return None
        names = tuple(dict.fromkeys((*reference.exact, *reference.halved)))
        error = BeamError(names, bool(reference.exact), bool(reference.halved))
        try:
            other = self._search(reference, run, monodromy, distance, free_period)
        except (IncompleteRunError, LinearizationError, la.LinAlgError):
            other = None
        if other is None:
            self._difference = np.zeros(0)
            return error
        return replace(error, columns=_compare(run, other))

    def _search(
        self,
        reference: RefinedBeams,
        run: PeriodRun,
        monodromy: Array,
        distance: float,
        free_period: bool,
    ) -> PeriodRun | None:
        """Return the motion of the reference close to another one, or None."""
        integrator = run.period_map.integrator
        if isinstance(integrator, Radau):
            rtol = min(_RTOL_RATIO * distance, _MAX_RTOL)
            integrator = replace(integrator, rtol=max(integrator.rtol, rtol))
        period_map = PeriodMap.from_equations(
            reference.equations, integrator, run.period_map.begin, run.period_map.period
        )
        linearization = Linearization.from_monodromy(run, monodromy, free_period)
        q, v = np.split(run.state, 2)
        q, v = reference.start + reference.prolongation @ q, reference.prolongation @ v
        if reference.halved:
            both = sp.block_diag([reference.prolongation] * 2).toarray()
            linearization = _TransferredLinearization(
                run, linearization.matrix, both @ linearization.persistent, both
            )
        state = np.concatenate([q, v])
        known = self._difference if len(self._difference) == len(state) else 0.0
        q, v = period_map.make_consistent(*np.split(state + known, 2))
        other, _ = solve_shooting(
            period_map,
            q,
            v,
            _TOLERANCE,
            free_period,
            linearization,
            None if reference.halved else run.amplitudes,
            _MAX_DIFFERENCE,
        )
        if other.relative_deviation > _TOLERANCE.accepted:
            return None
        following = _run_next_period(other)
        if following.relative_deviation <= _TOLERANCE.accepted:
            other = following
        self._difference = other.state - state
        return other


def _run_next_period(run: PeriodRun) -> PeriodRun:
    """Return the run over the period after a run that repeats.

    Corrections of the start by Newton's method disturb axial deformations by up to the tolerance.
    With the axial stiffness, this is a multiple of the section forces of beams that bend: N at the
    start was up to 10 times half its range. The vibrations decay within the long steps of a run.
    """
    period_map = run.period_map
    q, v = np.split(run.state + period_map.deviation(run.solution), 2)
    return PeriodRun.from_state(
        period_map, *period_map.make_consistent(q, v), amplitudes=run.amplitudes
    )


def _compare(run: PeriodRun, other: PeriodRun) -> dict[str, float]:
    """Return the relative errors of the columns and of a free period, see `BeamError.columns`.

    Columns that vary by rounding errors or errors of the integration are omitted.
    """
    ranges, others = run.solution._column_ranges, other.solution._column_ranges
    errors = {"period [s]": run.period_map.period / other.period_map.period - 1.0}
    is_noise = _mark_noise(run, other)
    for header, noise in zip(ranges, is_noise, strict=True):
        if noise:
            continue
        span, exact = ranges[header], others[header]
        ratios = (
            span.half_range / max(exact.half_range, _TINY),
            span.largest_magnitude / max(exact.largest_magnitude, _TINY),
        )
        errors[header] = max((x - 1.0 for x in ratios), key=abs)
    return errors


def _mark_noise(run: PeriodRun, other: PeriodRun) -> Array:
    """Return the mask of the columns that vary by errors only, such as those of fixed points."""
    solution, length = run.solution, run.solution.equations.length
    headers, mechanism = list(solution.columns), solution._sizes_of_mechanism
    values = np.stack(list(solution.columns.values()), axis=1)
    sizes, finer = (
        np.array([x.half_range for x in y.solution._column_ranges.values()]) for y in (run, other)
    )
    is_noise = mark_vanishing_columns(headers, sizes, length, values, mechanism)
    rate = 2.0 * np.pi / run.period_map.period
    is_noise |= mark_resting_columns(headers, values, sizes, length, rate, mechanism)
    # Deformations may be far smaller than travels, but not than the drift.
    is_drift, is_unresolved = (
        mark_unresolved_columns(
            headers,
            sizes,
            np.abs(sizes - finer),
            length,
            rtol,
            map(find_drift, (solution, other.solution)),
            mechanism,
            min_noise_share=0.0,
        )
        for rtol in (0.0, solution.integrator.get("rtol") or 0.0)
    )
    is_position = np.array([Header.of(x).unit in UNITS_OF_POSITIONS for x in headers], bool)
    return is_noise | np.where(is_position, is_drift, is_unresolved)


def _distance_from_resonance(monodromy: Array, free_period: bool) -> float:
    """Return the smallest distance of a multiplier from 1, at most 1.

    Errors change the response by their share over this distance. Free motions are not amplified:
    the multiplier 1 moves along the motion.
    """
    if free_period:
        return 1.0
    multipliers = np.linalg.eigvals(monodromy)
    return max(float(np.min(np.abs(1.0 - multipliers), initial=1.0)), _TINY)


def _estimate_mesh_errors(run: PeriodRun, distance: float) -> dict[str, float]:
    """Return the estimated effect of the elements of each beam on a motion, by name.

    An error e of the frequency turns a multiplier m by e omega T. It changes the response by this
    angle over |1 - m|, the `distance`.
    """
    amplitudes, rates = np.split(run.scales, 2)
    rate = float(np.max(rates / amplitudes))
    factor = rate * run.period_map.period / distance
    equations = run.period_map.equations
    beams = beams_of(equations.mechanism)
    return {x.name: factor * float(bending_wave_errors(x, np.array([rate]))[0]) for x in beams}


def _find_coarse_beams(run: PeriodRun, distance: float, free_period: bool) -> set[str]:
    """Return the names of beams whose elements are to be halved."""
    equations = run.period_map.equations
    errors = _estimate_mesh_errors(run, distance)
    positions = [x.state.q for x in sample_instants(run.solution.trajectory)]
    coarse = {name for name, error in errors.items() if error > _MIN_MESH_ERROR}
    coarse |= {x.name for x in find_taut_beams(equations, np.array(positions))}
    if not free_period:
        few = (x for x in beams_of(equations.mechanism) if x.mesh.elements <= _FEW_ELEMENTS)
        coarse |= {x.name for x in few}
    return coarse


def _build_reference(run: PeriodRun, coarse: Collection[str]) -> RefinedBeams | None:
    """Return the model with more accurate beams; None if there are none or parts are not copied."""
    equations = run.period_map.equations
    limited = {x.statement.part for x in equations.ranges if x.statement.defect is not None}
    return refine_beams(equations, exact=limited, halved=coarse)
