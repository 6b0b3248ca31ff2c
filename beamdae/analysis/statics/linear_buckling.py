"""Linear buckling: load factors at which the linearized tangent stiffness is singular."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.linalg as la
from scipy.sparse.linalg import splu

from beamdae import deferred
from beamdae.analysis.continuation.engine import CurveError, Point, prescribe_parameter
from beamdae.analysis.continuation.spectrum import find_slow_space
from beamdae.analysis.eigenproblems.eigensolution import locate_largest
from beamdae.analysis.eigenproblems.linearized_equations import is_symmetric_matrix
from beamdae.analysis.statics.load_scaling import build_loading, require_one_stage
from beamdae.analysis.statics.paths import (
    describe_zero_loads,
    dominant_coordinate,
    find_unloaded_equilibrium,
    follow_to_critical_point,
    free_coordinate,
)
from beamdae.analysis.statics.static_equilibrium import initial_positions
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import (
    BeamdaeError,
    require_count,
    require_finite,
    warn_of_result,
    warnings_are_ignored,
)
from beamdae.interrupts import interruptible
from beamdae.linear.blas_threads import single_threaded
from beamdae.model_functions import Model
from beamdae.parts.mechanism import Mechanism
from beamdae.results.displays import HasModeShapes
from beamdae.simulation import is_unchecked

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

_NAME = "buckling"
# Motion, in natural sizes, over which the tangent stiffness is differenced along the path.
_DIFFERENCE_MOTION = 1e-4
# Factors at which the linear response exceeds this motion, in natural sizes, are meaningless: for
# example, a shear instability of a column that is stretched by half its length.
_MAX_MOTION = 0.5
# Largest accepted deviation of the first factor from the first critical point of the path, which
# is sought up to this multiple of the first factor.
_MAX_ERROR = 0.03
_SEARCH_RATIO = 2.0
# Largest residual of the linearized path, relative to the load, up to which it counts as the path.
# Columns drawn with a tilt that causes 0.011 have first factors that are 0.26 % too low.
_MAX_IMBALANCE = 0.02
# Inverse factors below this fraction of the largest are lost in rounding; imaginary parts up to the
# second fraction are rounding.
_MIN_INVERSE_RATIO = 1e-9
_IMAGINARY_TOLERANCE = 1e-6
# Number of factors shown in the repr.
_REPR_FACTORS = 5


@dataclass(frozen=True, repr=False)
class Buckling(HasModeShapes):
    """Buckling loads and mode shapes of the linearized tangent stiffness; see `buckling`.

    Attributes
    ----------
    factors
        Positive factors of the scaled loads at which the structure buckles [-], (k,), ascending.
    shapes
        Mode shapes, (k, n), scaled so that the largest absolute coordinate, relative to its natural
        size, is 1; the first one, if several are equally large.
    moves
        Name of the coordinate that moves most in each mode.
    loads
        Names of the scaled loads.
    q
        Coordinates of the unloaded equilibrium, (n,).
    equations
        The equations of motion.
    t
        Time at which the loads are evaluated [s].
    notes
        Warnings of the model, and warnings that displacements before buckling are not negligible,
        that the loads have no potential, or that there are no factors.
    reason
        Why there are no factors; "" if there are.
    """

    factors: Array
    shapes: Array = field(repr=False)
    moves: tuple[str, ...]
    loads: tuple[str, ...]
    q: Array = field(repr=False)
    equations: EquationsOfMotion = field(repr=False)
    t: float
    notes: tuple[str, ...]
    reason: str = ""

    def __len__(self) -> int:
        return len(self.factors)

    def __repr__(self) -> str:
        factors = ", ".join(f"{x:.6g}" for x in self.factors[:_REPR_FACTORS])
        more = ", ..." if len(self) > _REPR_FACTORS else ""
        return f"<Buckling under {', '.join(self.loads)}: {factors or 'no factors'}{more}>"

    @property
    def mechanism(self) -> Mechanism | None:
        """The mechanism, for pictures of the modes."""
        return self.equations.mechanism

    @cached_property
    def errors(self) -> Any:
        """Errors of the load factors, see `Errors`, measured with refined beams."""
        return deferred.module("accuracy.statics").measure_buckling(self)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The `notes`, and large `errors`."""
        return (*self.notes, *self.errors.sentences())

    @property
    def about(self) -> str:
        """Description of the state to which the shapes are added."""
        return "the unloaded equilibrium"

    def describe(self, k: int) -> str:
        """Return a label of mode `k`, counted from 0: number k + 1 and load factor."""
        return f"{k + 1}: load factor {self.factors[k]:.5g}"

    def table(self) -> pd.DataFrame:
        """Return a table with number, load factor [-] and the coordinate that moves most."""
        import pandas as pd

        numbers = np.arange(1, len(self) + 1)
        return pd.DataFrame(
            {"mode": numbers, "load factor [-]": self.factors, "moves most": list(self.moves)}
        )


class _Solution(NamedTuple):
    """Factors at which the linearized tangent is singular.

    Attributes
    ----------
    factors, shapes
        Positive factors (k,), ascending, and their modes (k, n).
    reversed_factor
        Negative factor nearest to zero; -inf if there is none.
    response, motion
        Derivative of the path by the load factor, and its largest entry in natural sizes.
    has_potential
        True if the change of the stiffness is symmetric.
    """

    factors: Array
    shapes: Array
    reversed_factor: float
    response: Array
    motion: float
    has_potential: bool


@single_threaded
@interruptible
def buckling(
    model: Any,
    n: int = 5,
    loads: Any = None,
    t: float = 0.0,
    start: Any = None,
    *,
    accuracy: float | None = None,
    accuracy_columns: Sequence[str] | str | None = None,
) -> Buckling:
    """Compute linear buckling loads: factors mu with det(K_0 + mu K_1) = 0.

    K_0 is the tangent stiffness of the unloaded equilibrium, with the constraints and the axial and
    shear forces of beams as unknowns (mixed form), and K_1 its derivative with respect to the load
    factor along the linear response to the loads. The factors
    are exact if the displacements before buckling are negligible, as for straight columns and rings
    under pressure. If the first one deviates by more than 3 % from the first critical point of the
    equilibrium path, or the loads have no potential, so that the structure may flutter,
    `Buckling.warnings` contains a warning; use `equilibrium` instead. So have factors that differ
    by more than 4 % from those of halved elements with exact strains; see `Buckling.errors`.

    Parameters
    ----------
    model
        A model function (with its defaults) or a mechanism.
    n
        Number of positive factors to return, the smallest ones.
    loads
        Name or names of the loads that mu scales, as in `equilibrium`, in one stage. Loads that
        are not named act in full.
    t
        Time [s] at which laws are evaluated.
    start
        Positions near which the unloaded equilibrium is sought, as in `equilibrium`.
    accuracy
        Largest error of the required columns [-], from 1e-6 to 0.1, see `Errors`.
    accuracy_columns
        Columns of `errors` that must be accurate. Defaults to all factors.

    Returns
    -------
    Buckling
        Load factors and mode shapes; `plot` draws them.

    Raises
    ------
    BeamdaeError
        If an argument is invalid, no load is scaled, or the unloaded mechanism has no equilibrium,
        can move freely or has no unique linear response.
    Interrupted
        If Ctrl-C ends the call.

    Warns
    -----
    BeamdaeWarning
        For each of `Buckling.warnings`.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002)
    >>> column = mech.add(bd.Beam("column", bd.Line((0.0, 0.0), (0.0, 1.0)), strip))
    >>> clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), column.start))
    >>> press = mech.add(bd.Force("press", column.end, (0.0, -strip.EI)))
    >>> [round(float(x), 2) for x in bd.buckling(mech, n=2).factors]
    [2.47, 22.21]
    """
    count, t = require_count(_NAME, "n", n), require_finite(_NAME, "t", t)

    def solve(model: Any, _: Any = None) -> Buckling:
        return _compute_buckling(model, count, loads, t, start)

    until = deferred.module("accuracy.until")
    analysis = until.Analysis(_NAME, solve, start=start)
    result = until.reach_accuracy(analysis, model, accuracy, accuracy_columns)
    warn_of_result(result.notes, result.equations.build_warnings)
    if not (is_unchecked() or warnings_are_ignored()):
        warn_of_result(list(result.errors.sentences()))
    return result


def _compute_buckling(model: Any, count: int, loads: Any, t: float, start: Any) -> Buckling:
    """Return the result of `buckling` without issuing warnings."""
    if isinstance(model, Model):
        model = model()
    equations, q = initial_positions(_NAME, model, start)
    loading = build_loading(model, equations, loads, t, _NAME)
    loads = require_one_stage(_NAME, loading.stages)
    begin = find_unloaded_equilibrium(StaticProblem(loading.systems[0]), q)
    if begin.monitor.free:
        raise BeamdaeError(
            f"{_NAME}: {free_coordinate(begin)} can move without stiffness; add "
            "a joint or a spring."
        )
    solution = _solve(begin, count)
    e, factors, shapes = begin.problem.system.equations, solution.factors, solution.shapes
    notes = [*e.build_warnings, *_check_prebuckling(begin, solution)]
    reason = "" if len(factors) else _explain_no_factors(begin, solution)
    if reason and solution.has_potential:
        notes.append(f"{_NAME}: the structure has 0 of {count} buckling loads; {reason}.")
    moves = tuple(dominant_coordinate(e, shape) for shape in shapes)
    return Buckling(
        factors, shapes, moves, loads, begin.x[: e.n], equations, t, tuple(notes), reason
    )


def _explain_no_factors(begin: Point, solution: _Solution) -> str:
    """Return why a structure has no positive load factors."""
    if cause := describe_zero_loads(begin):
        return cause
    if np.isfinite(solution.reversed_factor):
        # The direction of the loads may be wrong.
        return f"under reversed loads, it buckles at the factor {-solution.reversed_factor:g}"
    return "these loads do not reduce its stiffness, in either direction"


def repeat_buckling(result: Buckling, equations: EquationsOfMotion, q: Array) -> Array:
    """Return the load factors (k,) of a refined mechanism, whose equilibrium is near `q` (n,)."""
    loads = list(result.loads)
    loading = build_loading(equations.mechanism, equations, loads, result.t, _NAME)
    begin = find_unloaded_equilibrium(StaticProblem(loading.systems[0]), q)
    return _solve(begin, len(result)).factors


def _check_prebuckling(begin: Point, solution: _Solution) -> list[str]:
    """Return warnings if the equilibrium path differs from its linearization, or if it may.

    There is none if the points of the linearization are in equilibrium, as those of columns whose
    imperfections are rounding errors of the drawing, or if the first critical point of the path is
    at the first factor. Displacements are not judged by their size, because even a rotation by the
    ratio of thickness to length makes the linearized stiffness of a slender beam useless.
    """
    if not solution.has_potential:
        return [
            f"{_NAME}: the loads have no potential, so the structure may flutter, which linear "
            "buckling does not show; use equilibrium with a target load factor."
        ]
    first = float(np.min(solution.factors, initial=np.inf))
    if not np.isfinite(first):
        return []
    targets = (1.0 - _MAX_ERROR) * first, (1.0 + _MAX_ERROR) * first
    ends = [begin.plus(mu * solution.response) for mu in targets]
    count, before, after = (x.monitor.divergent for x in (begin, *ends))
    if before == count < after and max(map(_imbalance, ends)) < _MAX_IMBALANCE:
        return []
    path = follow_to_critical_point(begin, (targets[1], _SEARCH_RATIO * first))
    found = [one.point.p for one in path.critical.values()]
    if found and abs(found[0] - first) <= _MAX_ERROR * found[0]:
        return []
    reason = f"is at {found[0]:.5g}" if found else f"lies beyond {path.end.p:.5g}"
    return [
        f"{_NAME}: displacements before buckling are not negligible: the first critical point of "
        f"the path {reason}, but the first linear factor is {first:.5g}; use equilibrium with "
        "control='arc length' instead."
    ]


def _imbalance(point: Point) -> float:
    sizes, linear = point.problem.system.equations.position_scales, point.linearization
    residual, load = (
        np.max(np.abs(forces[: len(sizes)]) * sizes)
        for forces in (linear.residual, linear.by_parameter)
    )
    return float(residual / abs(point.p * load))


def _solve(begin: Point, count: int) -> _Solution:
    """Return at most `count` factors: inverse eigenvalues of -K_0^-1 K_1.

    Raises
    ------
    BeamdaeError
        If the response is not unique.
    """
    problem, p = begin.problem, begin.p
    sizes, n = problem.system.equations.position_scales, problem.n
    try:
        response = begin.tangent(prescribe_parameter)
        solve = splu(problem.matrix(begin.x, p)).solve
    except (CurveError, RuntimeError) as error:
        raise BeamdaeError(
            f"{_NAME}: the unloaded equilibrium has no unique linear response ({error}); check "
            "joints and supports."
        ) from None
    motion = float(np.max(np.abs(response[:n]) / sizes))
    step = _DIFFERENCE_MOTION / motion if motion > 0.0 else 1.0
    before, after = (problem.matrix(begin.x + h * response[:-1], p + h) for h in (-step, step))
    rate = (after - before) / (2.0 * step)
    space = find_slow_space(lambda x: -solve(rate @ x), len(begin.x), 2 * count + 4)
    inverses, vectors = la.eig(space.reduced)
    is_real = np.abs(inverses.imag) <= _IMAGINARY_TOLERANCE * np.abs(inverses)
    least = max(_MIN_INVERSE_RATIO * np.max(np.abs(inverses), initial=0.0), motion / _MAX_MOTION)
    is_real &= np.abs(inverses) > least
    values, vectors = 1.0 / inverses[is_real].real, space.basis @ vectors[:, is_real].real
    order = [k for k in np.argsort(values) if values[k] > 0.0][:count]
    motions = problem.scales[:n, None] * vectors[:n, order] / sizes[:, None]
    motions /= motions[locate_largest(motions), np.arange(len(order))]
    stiffness = rate[:n, :n]
    return _Solution(
        values[order],
        (motions * sizes[:, None]).T,
        float(np.max(values[values < 0.0], initial=-np.inf)),
        response,
        motion,
        is_symmetric_matrix(stiffness, _IMAGINARY_TOLERANCE),
    )
