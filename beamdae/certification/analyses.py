"""Equilibria, natural modes and periodic motions with an estimated mesh error.

The error on the finest mesh follows from the ratio of the differences between three successive
meshes, each with elements half as long as those of the previous mesh. If a point slides along a
beam of many elements, only two meshes may be possible; then the largest ratio is assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from beamdae.analysis.eigenproblems.symmetric_eigenproblem import quadratic_form_rounding
from beamdae.analysis.linear_dynamics.linearization import warn_of_state
from beamdae.analysis.linear_dynamics.natural_modes import Modes, compute_modes
from beamdae.analysis.periodic.periodic_solution import periodic
from beamdae.analysis.periodic.shooting import DEFAULT_RTOL
from beamdae.analysis.statics.static_equilibrium import equilibrium
from beamdae.beams.beam import EXACT_FORMULATION
from beamdae.beams.remeshing import BaseMesh, choose_base_meshes, with_meshes
from beamdae.beams.sliding import MAX_ELEMENTS_WITH_SLIDER
from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    require_count,
    require_positive,
)
from beamdae.integrators import Integrator
from beamdae.interrupts import interruptible
from beamdae.parts.mechanism import Mechanism, require_start
from beamdae.results.analysis_certificate import AnalysisCertificate
from beamdae.results.certificate import MAX_ACCURACY
from beamdae.results.columns import (
    mark_required_columns,
    mark_resting_columns,
    require_certified_columns,
    require_observed,
)
from beamdae.results.outcome import Status
from beamdae.simulation import as_mechanism

Array = np.ndarray

_FIRST_ELEMENTS = 2
_MIN_MESHES = 3
# Elements of a beam up to which meshes are refined beyond the third.
_MAX_ELEMENTS = 32
# Factor applied to the error that follows from the ratio of two differences (Richardson).
_SAFETY_FACTOR = 2.0
# Largest ratio of successive differences; if they decrease more slowly, the error of a geometric
# series with this ratio is assumed.
_MAX_RATIO = 0.9
# Smallest stated error: rounding errors and tolerances of Newton's method and of eigenvalues.
_FLOOR = 1e-8
# Stated rounding error of a squared frequency / its bound. On meshes of 2 to 32 elements with L/h
# of 250 to 1e5, the standard deviation is 0.004 to 0.04 of the bound (0.004 to 0.015 from 12 on).
_ROUNDING_TO_BOUND_RATIO = 0.05
# The same for periodic motions: time error of an amplitude / rtol, at least; measured 0.1 to 0.9.
_PERIODIC_ERROR_TO_RTOL_RATIO = 3.0


class _Values(NamedTuple):
    """Values of an analysis on one mesh, and the scales to which their errors are relative.

    `at_rest` marks values whose scale is zero up to rounding: their relative error is set to 0.
    `rounding` contains the relative rounding errors if they may exceed the smallest stated error.
    """

    result: Any
    columns: tuple[str, ...]
    values: Array
    scales: Array
    at_rest: Array
    rounding: Array | float = 0.0


@interruptible
def certify_equilibrium(
    model: Any, accuracy: float = 0.01, columns: Sequence[str] | str | None = None, **settings: Any
) -> AnalysisCertificate:
    """Compute an equilibrium on meshes that are refined until its mesh error is small enough.

    Each mesh halves the elements of the previous one, until the required errors are small enough or
    a beam would have more than 32 elements. The first three meshes, from which errors are
    estimated, may have more elements, except along beams with sliding points; there, errors that
    follow from two meshes are larger, and a single mesh has infinite errors. Floating-frame beams
    are replaced by geometrically exact beams, unless their mesh must not change. If the path of the
    model as written fails, for example because it has a lower limit load, `notes` gives the reason.

    Parameters
    ----------
    model
        A model function or a mechanism.
    accuracy
        Largest permitted error of a column at the end of the path, relative to half the range of
        the column along the path (for a path of one row, to its magnitude) [-], at most 0.1.
    columns
        Observed columns, or names of observables, that must be within the accuracy. Defaults to all
        positions, angles and deflections [m, rad] or, if there are none, to all columns.
    settings
        Further arguments of `equilibrium`.

    Returns
    -------
    AnalysisCertificate
        The equilibrium on the finest mesh, with the error of each column.

    Raises
    ------
    BeamdaeError
        If the model or a setting is invalid, a path does not reach its target, or nothing is
        observed.
    Interrupted
        If Ctrl-C ends the call.
    """

    def evaluate(mechanism: Mechanism) -> _Values:
        path = equilibrium(mechanism, **settings)
        if not path.status.success:
            raise BeamdaeError(f"certify_equilibrium: {path.status.sentence}.")
        require_observed("certify_equilibrium", path.columns)
        rows = np.stack(list(path.columns.values()), axis=1)
        # A path of a single row begins at the equilibrium.
        scales = 0.5 * np.ptp(rows, axis=0) if len(rows) > 1 else np.abs(rows[-1])
        columns = tuple(path.columns)
        at_rest = mark_resting_columns(columns, rows, scales, path.equations.length)
        return _Values(path, columns, rows[-1], scales, at_rest)

    start = settings.get("start")
    return _certify("certify_equilibrium", model, accuracy, columns, evaluate, start)


@interruptible
def certify_modes(
    model: Any, accuracy: float = 0.01, n: int = 6, **settings: Any
) -> AnalysisCertificate:
    """Compute natural modes on meshes that are refined until their frequencies are accurate.

    Each mesh halves the elements of the previous one, until the required errors are small enough or
    a beam would have more than 32 elements. The first three meshes, from which errors are
    estimated, may have more elements, except along beams with sliding points; there, errors that
    follow from two meshes are larger, and a single mesh has infinite errors. Floating-frame beams
    are replaced by geometrically exact beams, unless their mesh must not change. Modes of different
    meshes are matched by their order.

    Parameters
    ----------
    model
        A model function or a mechanism.
    accuracy
        Largest permitted relative error of a frequency [-], at most 0.1.
    n
        Number of modes. Modes that coarse meshes do not have are assessed after further
        refinements.
    settings
        Further arguments of `modes`.

    Returns
    -------
    AnalysisCertificate
        The modes on the finest mesh, with the error of each frequency.

    Raises
    ------
    BeamdaeError
        If the model or a setting is invalid.
    Interrupted
        If Ctrl-C ends the call.

    Examples
    --------
    >>> import beamdae as bd
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.004)
    >>> mech = bd.Mechanism()
    >>> beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip))
    >>> clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    >>> certificate = bd.certify_modes(mech, accuracy=1e-3, n=2)
    >>> certificate.status.success, bool(abs(certificate.values[0] - 3.34) < 0.01)
    (True, True)
    """
    count = require_count("certify_modes", "n", n)

    def evaluate(mechanism: Mechanism) -> _Values:
        # The certificate states the errors of meshes, of which the coarse ones need no warning.
        result: Modes = compute_modes(mechanism, n=count, assessed=0, **settings)
        warn_of_state(result._linearization)
        names = tuple(f"mode {k} [Hz]" for k in range(1, len(result) + 1))
        frequencies = result.frequencies
        # Motions without strain have the frequency 0.
        at_rest = mark_resting_columns(names, frequencies[None], frequencies, 0.0)
        values = _Values(result, names, frequencies, frequencies, at_rest)
        return values._replace(rounding=_frequency_rounding(result, at_rest))

    about = settings.get("about")
    if isinstance(about, Mapping):
        settings["about"] = about = require_start("about", about)
    return _certify("certify_modes", model, accuracy, None, evaluate, about)


@interruptible
def certify_periodic(
    model: Any,
    period: float,
    accuracy: float = 0.01,
    columns: Sequence[str] | str | None = None,
    **settings: Any,
) -> AnalysisCertificate:
    """Find a periodic motion on meshes that are refined until its amplitudes are accurate.

    Each mesh halves the elements of the previous one, until the required errors are small enough or
    a beam would have more than 32 elements. The first three meshes, from which errors are
    estimated, may have more elements, except along beams with sliding points; there, errors that
    follow from two meshes are larger, and a single mesh has infinite errors. Floating-frame beams
    are replaced by geometrically exact beams, unless their mesh must not change. Time errors are
    not estimated; with an integrator that has an rtol (by default 1e-8), the stated errors are at
    least 3 rtol.

    Parameters
    ----------
    model
        A model function or a mechanism.
    period
        Period of the motion [s].
    accuracy
        Largest permitted relative error of an amplitude [-], at most 0.1. The amplitude is half the
        range of a column.
    columns
        Observed columns, or names of observables, that must be within the accuracy. Defaults to all
        positions, angles and deflections [m, rad] or, if there are none, to all columns.
    settings
        Further arguments of `periodic`.

    Returns
    -------
    AnalysisCertificate
        The periodic motion on the finest mesh, with the error of the amplitude of each column.

    Raises
    ------
    BeamdaeError
        If the model or a setting is invalid, no periodic motion is found, or nothing is observed.
    Interrupted
        If Ctrl-C ends the call.
    """

    def evaluate(mechanism: Mechanism) -> _Values:
        motion = periodic(mechanism, period, **settings)
        if not motion.status.success:
            raise BeamdaeError(f"certify_periodic: {motion.status.sentence}.")
        observed = motion.solution.columns
        require_observed("certify_periodic", observed)
        ranges = motion.solution._column_ranges.values()
        amplitudes = np.array([x.half_range for x in ranges])
        columns, rows = tuple(observed), np.stack(list(observed.values()), axis=1)
        at_rest = mark_resting_columns(columns, rows, amplitudes, motion.solution.equations.length)
        return _Values(motion, columns, amplitudes, amplitudes, at_rest)

    integrator = settings.get("integrator")
    name, value = "rtol", DEFAULT_RTOL
    if isinstance(integrator, Integrator):  # `periodic` rejects other objects
        name, value = integrator.accuracy
    floor = _PERIODIC_ERROR_TO_RTOL_RATIO * value if name == "rtol" else _FLOOR
    start = settings.get("start")
    return _certify("certify_periodic", model, accuracy, columns, evaluate, start, floor)


def _certify(
    name: str,
    model: Any,
    accuracy: Any,
    columns: Sequence[str] | str | None,
    evaluate: Callable[[Mechanism], _Values],
    start: Any,
    floor: float = _FLOOR,
) -> AnalysisCertificate:
    """Evaluate an analysis on successively finer meshes; `name` begins the messages.

    Beams with coordinates named in `start` keep their meshes. `floor` is the smallest stated error.
    """
    accuracy = require_positive(name, "accuracy", accuracy)
    if accuracy > MAX_ACCURACY:
        most, given = format_distinct(MAX_ACCURACY, accuracy)
        raise BeamdaeError(f"{name}: accuracy must be at most {most}, got {given}; 0.01 is 1 %.")
    names = require_certified_columns(name, columns)
    model = as_mechanism(name, model)
    bases = choose_base_meshes(model, _FIRST_ELEMENTS, start)
    notes = tuple(
        f"{beam}: mesh and theory are not assessed, because {base.fixed_by}."
        for beam, base in bases.items()
        if base.fixed_by
    )
    refinable = [base for base in bases.values() if not base.fixed_by]
    levels = [_evaluate(model, bases, 0, True, evaluate)]
    required = mark_required_columns(name, names, levels[0].columns)
    if not refinable:
        # Without beams, there is no mesh error.
        error = np.full(len(levels[0].values), floor if not bases else np.nan)
        return _finish(levels, error, error * 0.0, required, accuracy, floor, bases, notes)
    error = np.full(len(levels[0].values), np.inf)
    # Finer meshes do not reduce the stated error below the floor.
    while len(levels) < _MIN_MESHES or not _is_within(error, required, max(accuracy, floor)):
        halvings = len(levels)
        if not _can_refine(refinable, halvings):
            break
        levels.append(_evaluate(model, bases, halvings, True, evaluate))
        required = mark_required_columns(name, names, levels[-1].columns)
        error = np.maximum(_estimate_errors(levels), np.maximum(levels[-1].rounding, floor))
    written = fine = levels[-1]
    skipped = ""
    if any(not base.is_exact for base in refinable):
        try:
            written = _evaluate(model, bases, len(levels) - 1, False, evaluate)
        except BeamdaeError as failure:
            reason = str(failure).removeprefix(f"{name}: ").rstrip(".")
            skipped = f"The formulations of the model fail and are not assessed: {reason}."
    theory = _relative(_resize(written.values, len(fine.values)) - fine.values, fine)
    if skipped:
        theory[:] = np.nan
    certificate = _finish(levels, error, theory, required, accuracy, floor, bases, notes)
    return replace(certificate, notes=(*notes, skipped)) if skipped else certificate


def _can_refine(refinable: Sequence[BaseMesh], halvings: int) -> bool:
    """Return True if a mesh with this number of halvings may be evaluated."""
    counts = [base.refined(halvings).elements for base in refinable]
    with_slider = [n for base, n in zip(refinable, counts, strict=True) if base.has_slider]
    if max(with_slider, default=0) > MAX_ELEMENTS_WITH_SLIDER:
        return False
    return halvings < _MIN_MESHES or max(counts) <= _MAX_ELEMENTS


def _evaluate(
    mechanism: Mechanism,
    bases: dict[str, BaseMesh],
    halvings: int,
    exact: bool,
    evaluate: Callable[[Mechanism], _Values],
) -> _Values:
    meshes = {name: base.refined(halvings) for name, base in bases.items()}
    formulations = {
        name: EXACT_FORMULATION for name, base in bases.items() if exact and base.can_be_exact
    }
    return evaluate(with_meshes(mechanism, meshes, formulations))


def _estimate_errors(levels: Sequence[_Values]) -> Array:
    """Return the estimated relative errors on the finest of at least two meshes.

    The ratio of two meshes is unknown; the largest is assumed. The errors of modes that one of the
    last three meshes does not have are infinite.
    """
    count = len(levels[-1].values)
    *coarser, middle, fine = (_resize(level.values, count) for level in levels[-_MIN_MESHES:])
    last = np.abs(fine - middle)
    ratio = np.full(count, _MAX_RATIO)
    for coarse in coarser:
        before = np.maximum(np.abs(middle - coarse), np.finfo(float).tiny)
        ratio = np.minimum(last / before, _MAX_RATIO)
    error = _relative(_SAFETY_FACTOR * ratio / (1.0 - ratio) * last, levels[-1])
    missing = np.isnan(np.stack([*coarser, middle])).any(axis=0)
    return np.where(missing, np.inf, error)


def _frequency_rounding(result: Modes, at_rest: Array) -> Array:
    """Return the relative rounding errors of frequencies: those of x^H K x / (2 |l|^2).

    The stiffnesses EA and GA of thin beams leave them in the stiffness matrix.
    """
    bound = quadratic_form_rounding(result._linearization.tangent.stiffness, result.shapes.T)
    squares = np.where(at_rest, np.inf, np.abs(result.eigenvalues) ** 2)
    return _ROUNDING_TO_BOUND_RATIO * bound / (2.0 * squares)


def _resize(values: Array, count: int) -> Array:
    """Return the first `count` values; missing values are NaN.

    Only modes differ in number between meshes and formulations.
    """
    resized = np.full(count, np.nan)
    resized[: len(values)] = values[:count]
    return resized


def _relative(differences: Array, fine: _Values) -> Array:
    """Return |differences| / scales, or 0 for values at rest."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(fine.at_rest, 0.0, np.abs(differences) / fine.scales)


def _is_within(error: Array, required: Array, accuracy: float) -> bool:
    return bool(np.all(error[required] <= accuracy))


def _finish(
    levels: Sequence[_Values],
    error: Array,
    theory: Array,
    required: Array,
    accuracy: float,
    floor: float,
    bases: dict[str, BaseMesh],
    notes: tuple[str, ...],
) -> AnalysisCertificate:
    last = levels[-1]
    if _is_within(error, required, accuracy):
        status = Status("ok", f"all required columns are within {accuracy:g}")
    elif accuracy < floor and _is_within(error, required, floor):
        status = Status(
            "limited",
            f"the estimated error is {floor:g}, the smallest that is stated, and exceeds "
            f"{accuracy:g}",
        )
    else:
        counts = [x.refined(len(levels) - 1).elements for x in bases.values() if not x.fixed_by]
        limit = max([_MAX_ELEMENTS, *counts])
        status = Status(
            "limited", f"the estimated error exceeds {accuracy:g} with up to {limit} elements"
        )
        if notes:
            status = Status("failed", "the mesh error is not assessed")
    return AnalysisCertificate(
        result=last.result,
        columns=last.columns,
        values=last.values,
        scales=last.scales,
        mesh=error,
        theory_as_written=theory,
        required=required,
        accuracy=accuracy,
        status=status,
        elements={name: base.refined(len(levels) - 1).elements for name, base in bases.items()},
        meshes=len(levels),
        notes=notes,
    )
