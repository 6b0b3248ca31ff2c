"""Growing modes of the equations linearized about states of a run, and the loads that cause them.

Loads cause the growth of a mode if it vanishes without their derivatives. The growth of modes by
the motion of the mechanism itself, such as the decreasing inertia of a retracted arm, remains.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from beamdae.analysis.linear_dynamics.law_derivatives import differentiate_law
from beamdae.analysis.linear_dynamics.linear_model import StateReduction
from beamdae.analysis.linear_dynamics.linearization import Linearization, linearize_motion
from beamdae.equations.assembly.building import select_input_laws
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.sums import term_data
from beamdae.results.trajectory import Instant, Trajectory
from beamdae.symbolic.kernel_groups import group_by_kernel

Array = np.ndarray

# Growth rates that remain without the loads that cause a growth, relative to it
_MAX_OPEN_RATIO = 0.5
_ROUNDING = 1e-9  # of derivatives of loads, and of numbers of samples


class Modes(NamedTuple):
    """Growing modes: eigenvalues [1/s], (k,), and motions of the coordinates (n, k)."""

    values: Array
    motions: Array


class LinearizedRun:
    """Equations linearized about a state of a run.

    Attributes
    ----------
    lin
        The linearized equations.
    loads
        Derivatives (dF/dq, dF/dv) of the loads that may supply energy, and of those in `commanded`,
        by name of the part.
    sources
        Names of the loads that may supply energy to vibrations.
    """

    def __init__(
        self,
        equations: EquationsOfMotion,
        trajectory: Trajectory,
        t: float,
        commanded: Collection[str] = (),
        at_rest: bool = False,
    ) -> None:
        times = np.array([t])
        (time,), states = trajectory.at(times)
        interval = trajectory.intervals[int(trajectory.interval_index(times)[0])]
        state = State(*(x[0] for x in states))
        if at_rest:
            state = state._replace(v=np.zeros(equations.n))
        self.lin = linearize_motion(equations, Instant(time, state, interval.configuration))
        self.loads: dict[str, tuple[sp.csr_array, sp.csr_array]] = {}
        self.sources: set[str] = set()
        for name, stiffness, damping, is_source in _differentiate_loads(self.lin, commanded):
            before = self.loads.get(name, (0.0 * stiffness, 0.0 * damping))
            self.loads[name] = before[0] + stiffness, before[1] + damping
            self.sources |= {name} if is_source else set()

    @property
    def mass(self) -> sp.csc_array:
        """Mass matrix (n, n)."""
        return self.lin.tangent.mass

    def reduce(self, without: Collection[str] = ()) -> StateReduction | None:
        """Return the reduced equations without the derivatives of some loads; None if rigid."""
        tangent = self.lin.tangent
        for name in self.loads.keys() & set(without):
            stiffness, damping = self.loads[name]
            tangent = tangent._replace(
                stiffness=sp.csc_array(tangent.stiffness - stiffness),
                damping=sp.csc_array(tangent.damping - damping),
            )
        reduction = StateReduction(replace(self.lin, tangent=tangent), ())
        return reduction if len(reduction.x_indices) else None

    def find_growing(self, min_rate: float, without: Collection[str] = ()) -> Modes:
        """Return the modes that grow faster than a rate [1/s], one of each conjugate pair."""
        reduction = self.reduce(without)
        if reduction is None:
            return Modes(np.zeros(0, complex), np.zeros((self.lin.equations.n, 0)))
        matrix = reduction.linear_model(()).A
        # Shift and invert: of stiff structures, rounding errors of A reach the slow modes.
        inverses, vectors = la.eig(la.inv(matrix - min_rate * np.eye(len(matrix))))
        values = min_rate + 1.0 / inverses
        is_growing = (values.real > min_rate) & (values.imag >= 0.0)
        motions = reduction.z @ vectors[: len(reduction.x_indices), is_growing]
        return Modes(values[is_growing], motions)

    def find_cause(self, rate: float) -> str:
        """Return the names of the loads without which no vibration grows at half of a rate [1/s]."""
        names = sorted(self.sources)
        for loads in (*([x] for x in names), names):
            values = self.find_growing(_MAX_OPEN_RATIO * rate, loads).values
            if not np.any(values.imag > values.real):
                return ", ".join(loads)
        return ""


def _differentiate_loads(
    lin: Linearization, commanded: Collection[str]
) -> Iterator[tuple[str, sp.csr_array, sp.csr_array, bool]]:
    """Yield name, dF/dq, dF/dv (n, n) and `is_source` of forces without inertia."""
    e = lin.equations
    if e.mechanism is None:
        return
    laws = select_input_laws(e.mechanism.inputs)
    states = {x.name for x in e.parts if x.is_state}
    forces = [x.with_laws(laws) for part in e.statements for x in part.forces]
    for group, term in zip(group_by_kernel(forces), e.structure.forces, strict=True):
        kernel, count, size = term.kernel, term.count, term.kernel.local.size
        names = [forces[k].part for k in group.members for _ in range(forces[k].count)]
        if term.rotation is not None or kernel.has_accelerations or states.issuperset(names):
            continue
        operator = sp.csr_array(term.operator)
        q, v, scales = (
            np.reshape(x, (count, size))
            for x in (
                operator @ lin.state.q,
                operator @ lin.state.v,
                abs(operator) @ e.position_scales,
            )
        )
        rows = np.zeros(0, int) if term.rows is None else term.rows.indices
        lam = lin.state.lam[rows].reshape(count, -1)
        time = np.repeat(lin.time[None], count, axis=0)
        values = kernel.motion_derivatives(time, q, v, lam, term_data(e, term).T)
        # Columns are consecutive.
        values = np.swapaxes(values.reshape(count, 2, size, size), 2, 3)
        is_source = _supplies_energy(values * scales[:, None, :, None] * scales[:, None, None])
        for k in np.flatnonzero(is_source | np.isin(names, list(commanded))).tolist():
            own = operator[k * size : (k + 1) * size]
            stiffness, damping = (sp.csr_array(own.T @ (x @ own)) for x in values[k])
            yield names[k], stiffness, damping, bool(is_source[k])


def _supplies_energy(values: Array) -> Array:
    """Return True (k,) for loads (k, 2, n, n) of circulatory stiffness or negative damping."""
    largest = np.max(np.abs(values), axis=(2, 3))
    sums = values + np.swapaxes(values, 2, 3)
    least = np.linalg.eigvalsh(sums[:, 1])[:, 0]
    skew = np.max(np.abs(values[:, 0] - np.swapaxes(values[:, 0], 1, 2)), axis=(1, 2))
    return (skew > _ROUNDING * largest[:, 0]) | (-least > _ROUNDING * largest[:, 1])


def find_loop_mode(
    equations: EquationsOfMotion, trajectory: Trajectory, t: float, loads: Collection[str]
) -> complex | None:
    """Return the fastest growing eigenvalue of the control loops, or None.

    Growth that remains with constant commands belongs to no loop. Sampled loops are linearized
    exactly: by the motion between two samples, and the derivatives of the laws.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    t
        Time [s] of the positions about which the equations are linearized at rest.
    loads
        Names of the loads that depend on continuous controllers.
    """
    run = LinearizedRun(equations, trajectory, t, loads, at_rest=True)
    if equations.controllers:
        values, opened = (_sampled_poles(run, trajectory, x) for x in (True, False))
    else:
        values, opened = (run.find_growing(0.0, x).values for x in ((), loads))
    if not len(values):
        return None
    fastest = complex(values[np.argmax(values.real)])
    is_of_loop = np.max(opened.real, initial=0.0) <= _MAX_OPEN_RATIO * fastest.real
    return fastest if is_of_loop and fastest.real > 0.0 else None


def _sampled_poles(run: LinearizedRun, trajectory: Trajectory, is_closed: bool) -> Array:
    """Return the poles [1/s] of sampled loops; none if a law or the samples have no linear model.

    The sampling intervals must be multiples of the shortest one, and divisors of the longest one.
    """
    equations, reduction = run.lin.full_equations, run.reduce()
    terms = equations.controllers
    intervals = np.array([x.controller.every for x in terms])
    ratios = np.round(intervals / np.min(intervals)).astype(int)
    is_regular = np.abs(intervals / np.min(intervals) - ratios) < _ROUNDING
    laws = [differentiate_law(equations, trajectory, x, k) for k, x in enumerate(terms)]
    if reduction is None or not is_regular.all() or np.any(np.max(ratios) % ratios):
        return np.zeros(0, complex)
    model = reduction.linear_model([read for term in terms for read in term.reads])
    place = {int(row): k for k, row in enumerate(reduction.x_indices)}
    step, total = la.expm(np.min(intervals) * model.A), np.eye(len(model.A))
    for k in range(int(np.max(ratios))):
        sample, first = np.eye(len(model.A)), 0
        for term, law, ratio in zip(terms, laws, ratios, strict=True):
            if law is None:
                return np.zeros(0, complex)
            by_reads, by_values = law
            own = [place[x] for x in range(term.rows.start, term.rows.stop)]
            outputs = model.C[first : first + by_reads.shape[1]]
            first += by_reads.shape[1]
            if k % ratio == 0:
                sample[own] = is_closed * by_reads @ outputs
                sample[np.ix_(own, own)] += by_values
        total = step @ sample @ total
    multipliers = la.eigvals(total).astype(complex)
    # Delays have multipliers of zero.
    multipliers = np.where(multipliers == 0.0, np.finfo(float).tiny, multipliers)
    return np.log(multipliers) / np.max(intervals)
