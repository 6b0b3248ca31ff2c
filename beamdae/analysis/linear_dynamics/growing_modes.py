"""Growing modes of the equations linearized about states of a run, and the loads that cause them.

Loads cause the growth of a mode if it vanishes without their derivatives. The growth of modes by
the motion of the mechanism itself, such as the decreasing inertia of a retracted arm, remains.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.optimize as opt
import scipy.sparse as sp

from beamdae.analysis.linear_dynamics.linear_model import LinearModel, reduce_to_states
from beamdae.analysis.linear_dynamics.linearization import Linearization, linearize_motion
from beamdae.equations.controller_reads import evaluate_reads
from beamdae.equations.equations_of_motion import ControllerTerm, EquationsOfMotion, Observable
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.model_checks.load_derivatives import LoadDerivatives, RunState, differentiate_loads
from beamdae.results.trajectory import Instant, Trajectory

Array = np.ndarray

# Growth rates that remain without the loads that cause a growth, relative to it
_MAX_OPEN_RATIO = 0.5
_ROUNDING = 1e-9  # of numbers of samples
_MAX_SAMPLES = 60  # between which a law is evaluated
# Steps of finite differences, relative to the ranges of the arguments in the run: the largest one
# whose differences to either side, with the step and its half, agree to within the deviation. Laws
# round their readings as encoders do, or have limits.
_STEPS, _MAX_DEVIATION = np.geomspace(3e-2, 1e-6, 10), 3e-2
_SIDES = np.array([-1.0, -0.5, 0.5, 1.0])


class Modes(NamedTuple):
    """Growing modes: eigenvalues [1/s], (k,), and motions of the coordinates (n, k)."""

    values: Array
    motions: Array


class LinearizedState:
    """Equations linearized about a state of a run.

    Attributes
    ----------
    lin
        The linearized equations.
    loads
        Derivatives of loads, see `differentiate_loads`.
    """

    def __init__(self, at: RunState, loads: Mapping[str, LoadDerivatives]) -> None:
        self.loads = loads
        if at.equations.redundant:
            instant = Instant(at.time, at.state, None)
            self.lin = linearize_motion(replace(at.equations, configurations=None), instant)
        else:
            tangent = compute_tangent(at.equations, at.time, at.state)
            self.lin = Linearization(at.equations, at.whole, "run", at.time, at.state, tangent)

    @property
    def mass(self) -> sp.csc_array:
        """Mass matrix (n, n)."""
        return self.lin.tangent.mass

    def reduce(
        self, without: Collection[str] = (), reads: Sequence[Observable] = ()
    ) -> LinearModel:
        """Return the state-space model, with `reads` as outputs, without derivatives of loads."""
        tangent = self.lin.tangent
        for name in self.loads.keys() & set(without):
            stiffness, damping, _ = self.loads[name]
            tangent = tangent._replace(
                stiffness=sp.csc_array(tangent.stiffness - stiffness),
                damping=sp.csc_array(tangent.damping - damping),
            )
        return reduce_to_states(replace(self.lin, tangent=tangent), (), reads)

    def find_growing(self, min_rate: float, without: Collection[str] = ()) -> Modes:
        """Return the modes that grow faster than a rate [1/s], one of each conjugate pair."""
        model = self.reduce(without)
        # Shift and invert: of stiff structures, rounding errors of A reach the slow modes.
        shifted = model.A - min_rate * np.eye(len(model.A))
        inverses, vectors = np.linalg.eig(np.linalg.inv(shifted))
        values = min_rate + 1.0 / inverses
        is_growing = (values.real > min_rate) & (values.imag >= 0.0)
        return Modes(values[is_growing], model._motions @ vectors[:, is_growing])

    def find_cause(self, rate: float) -> str:
        """Return the names of loads without which no vibration grows at half of a rate [1/s]."""
        names = sorted(name for name, x in self.loads.items() if x.is_source)
        for loads in (*([x] for x in names), names):
            values = self.find_growing(_MAX_OPEN_RATIO * rate, loads).values
            if not np.any(values.imag > 0.0):
                return ", ".join(loads)
        return ""


def find_loop_mode(
    at: RunState, trajectory: Trajectory, commanded: Collection[str], min_rate: float
) -> complex | None:
    """Return the fastest eigenvalue of control loops that grows faster than a rate, or None.

    Growth that remains with constant commands belongs to no loop. Sampled loops are linearized
    exactly: by the motion between two samples, and the derivatives of the laws.

    Parameters
    ----------
    at
        State about which the equations are linearized, with commands between their limits.
    trajectory
        The steps of the run, at whose samples laws are differentiated.
    commanded
        Names of the loads that depend on continuous controllers.
    min_rate
        Growth rate [1/s].
    """
    run = LinearizedState(at, differentiate_loads(at, commanded))
    if at.whole.controllers:
        values, open_values = (_sampled_poles(run, trajectory, x) for x in (None, commanded))
    else:
        values, open_values = (run.find_growing(min_rate, x).values for x in ((), commanded))
    if not len(values):
        return None
    fastest = complex(values[np.argmax(values.real)])
    is_of_loop = np.max(open_values.real, initial=0.0) <= _MAX_OPEN_RATIO * fastest.real
    return fastest if is_of_loop and fastest.real > min_rate else None


def _sampled_poles(
    run: LinearizedState, trajectory: Trajectory, opened: Collection[str] | None
) -> Array:
    """Return the poles [1/s] of sampled loops; none if a law or the samples have no linear model.

    If `opened` is not None, commands of sampled loops and of these loads are constant.
    The sampling intervals must be multiples of the shortest one, and divisors of the longest one.
    """
    equations = run.lin.full_equations
    terms = equations.controllers
    intervals = np.array([x.controller.every for x in terms])
    ratios = np.round(intervals / np.min(intervals)).astype(int)
    is_regular = np.abs(intervals / np.min(intervals) - ratios) < _ROUNDING
    found = [_differentiate_law(equations, trajectory, x, k) for k, x in enumerate(terms)]
    laws = [x for x in found if x is not None]
    if len(laws) < len(found) or not is_regular.all() or np.any(np.max(ratios) % ratios):
        return np.zeros(0, complex)
    model = run.reduce(opened or (), [read for term in terms for read in term.reads])
    place = {state.name: k for k, state in enumerate(model.states)}
    step, total = la.expm(np.min(intervals) * model.A), np.eye(len(model.A))
    for k in range(int(np.max(ratios))):
        sample, first = np.eye(len(model.A)), 0
        for term, law, ratio in zip(terms, laws, ratios, strict=True):
            by_reads, by_values = law
            own = [place[x.name] for x in equations.coordinates[term.rows]]
            outputs = model.C[first : first + by_reads.shape[1]]
            first += by_reads.shape[1]
            if k % ratio == 0:
                sample[own] = by_reads @ outputs if opened is None else 0.0
                sample[np.ix_(own, own)] += by_values
        total = step @ sample @ total
    multipliers = la.eigvals(total).astype(complex)
    # Delays have multipliers of zero.
    multipliers = np.where(multipliers == 0.0, np.finfo(float).tiny, multipliers)
    return np.log(multipliers) / np.max(intervals)


def _differentiate_law(
    equations: EquationsOfMotion, trajectory: Trajectory, term: ControllerTerm, stream: int
) -> tuple[Array, Array] | None:
    """Return the derivatives of a sampled law by its reads and by its values before a sample.

    A law is a function of the user, which may have limits, switches, delays and rounding. The
    derivatives are those between the samples of the largest change of a command, in the middle of
    this change: away from limits. None if the law jumps there, as relays do. `stream` is the number
    of the controller.
    """
    controller = term.controller
    every, n_driven = controller.every, len(controller.drives)
    first, last = np.ceil(trajectory.start / every) + 1, np.floor(trajectory.end / every)
    if not controller.reads or last - first < 1:
        return None
    # Unstable loops are far from their limits at first.
    samples = first - 1 + np.geomspace(1, last - first + 1, _MAX_SAMPLES)
    indices = np.unique(np.minimum(samples, last).astype(int)).tolist()
    times = every * np.array(indices)
    reads = evaluate_reads(term, equations.p, *trajectory.at(times))
    before = trajectory.positions_at(times - 0.5 * every)[:, term.rows]
    arguments, n_reads = np.hstack([reads, before]), reads.shape[1]
    ranges = np.ptp(arguments, axis=0)
    scales = np.where(ranges > 0.0, ranges, 1.0 + np.abs(arguments[0]))
    # The new commands among the values, which delays hold back.
    newest = slice(n_driven * controller.delay, n_driven * (1 + controller.delay))

    def law(index: int, x: Array) -> Array:
        return controller.next_values(every * index, index, x[:n_reads], x[n_reads:], stream)

    jumps = np.array(
        [
            law(k, y)[newest] - law(k, x)[newest]
            for k, (x, y) in zip(indices[:-1], pairwise(arguments), strict=True)
        ]
    )
    row, drive = map(int, np.unravel_index(np.argmax(np.abs(jumps)), jumps.shape))
    index, (begin, end) = indices[row], arguments[row : row + 2]
    middle = law(index, begin)[newest][drive] + 0.5 * jumps[row, drive]

    def excess(share: float) -> float:
        return float(law(index, begin + share * (end - begin))[newest][drive] - middle)

    if not jumps[row, drive]:
        return None
    x = begin + opt.brentq(excess, 0.0, 1.0) * (end - begin)
    derivatives = _difference(partial(law, index), x, scales)
    if derivatives is None or not np.any(derivatives[newest, :n_reads]):
        return None
    by_reads, by_values = np.split(derivatives / scales, [n_reads], axis=1)
    return by_reads, by_values


def _difference(law: Callable[[Array], Array], x: Array, scales: Array) -> Array | None:
    """Return the derivatives (values, arguments) of a law, times scales, or None at a jump."""
    for step in _STEPS:
        slopes = np.array(
            [[(law(x + h * dx) - law(x)) / h for dx in np.diag(scales)] for h in step * _SIDES]
        )
        # Values have different units.
        sizes = np.max(np.abs(slopes), axis=(0, 1))
        if np.all(np.ptp(slopes, axis=0) <= _MAX_DEVIATION * sizes):
            return np.mean(slopes, axis=0).T
    return None
