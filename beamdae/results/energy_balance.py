"""Energy balance, residual and constraint drift of a run, and runs at rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from beamdae.equations import measures
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.read_only import read_only_data
from beamdae.results.trajectory import Trajectory

# Largest change of coordinates by rounding errors, relative to the length of the mechanism or 1 rad
# and to their values.
_ROUNDING = 1e-12
_RESIDUAL = 6  # column of the energy balance, after three energies and three powers


def is_at_rest(equations: EquationsOfMotion, trajectory: Trajectory, largest_force: float) -> bool:
    """Return True if coordinates change by rounding errors only, and so do all forces.

    The terms of a formula may cancel, for example those of a spring at its natural length, so that
    the largest force of a run is a rounding error.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    largest_force
        Largest entry of the forces and the reactions in the run.
    """
    is_selected = np.ones(equations.n, bool)
    return _moves_by_rounding(equations, trajectory, is_selected) and has_rounding_forces(
        equations, trajectory, largest_force
    )


def has_rounding_forces(
    equations: EquationsOfMotion, trajectory: Trajectory, largest_force: float
) -> bool:
    """Return True if bodies move by rounding errors only, and all forces are rounding errors.

    States of signals, such as the integral of a controller without an actuator, may change. See
    `is_at_rest` for the parameters.
    """
    is_body = np.ones(equations.n, bool)
    is_body[equations.states] = False
    if not _moves_by_rounding(equations, trajectory, is_body):
        return False
    first = trajectory.intervals[0]
    start = first.rows.q[:1]
    rounding = _measure_rounding(equations, start[0])
    zero = np.zeros_like(start)
    times, lam = np.array([[first.t[0], first.branch]]), np.zeros((1, equations.m))
    states = ((start + sign * rounding, zero, zero, lam) for sign in (-1.0, 1.0))
    evaluate = measures.BalanceRows(equations)
    # Without accelerations and multipliers, the residual consists of forces.
    residuals = (evaluate(times, *state)[0, _RESIDUAL] for state in states)
    return bool(largest_force <= max(residuals))


def _moves_by_rounding(
    equations: EquationsOfMotion, trajectory: Trajectory, is_selected: np.ndarray
) -> bool:
    start = trajectory.intervals[0].rows.q[:1]
    rounding = np.where(is_selected, _measure_rounding(equations, start[0]), np.inf)
    # The last row first, which shows most motions.
    rows = (x.rows.q for x in trajectory.intervals)
    changes = (np.abs(q - start) for x in rows for q in (x[-1:], x))
    return all(bool((x <= rounding).all()) for x in changes)


def _measure_rounding(equations: EquationsOfMotion, q: np.ndarray) -> np.ndarray:
    size = np.maximum(np.where(equations.is_angle, 1.0, equations.length), np.abs(q))
    return np.asarray(_ROUNDING * size)


Array = np.ndarray

_TINY = np.finfo(float).tiny
# Energies below the sum of these two terms are rounding noise.
_ROUNDING_OF_FORCES = 1e-8  # relative to the largest force times the length of the mechanism
_ROUNDING_OF_ENERGIES = 1e-11  # relative to the largest energy
# Signs of (kinetic, strain, gravity, work of loads, work of drivers, dissipated) in the balance.
_BALANCE_SIGNS = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Quality:
    """Accuracy measures of a run: maxima over all steps.

    Attributes
    ----------
    max_residual
        Largest absolute entry of the residual F + G^T lam, relative to the largest absolute entry
        of G^T lam and of F at a = 0 [-].
    max_position_drift, max_velocity_drift
        Largest violations |g| [m or rad] and |g_dot| [m/s or rad/s] of a constraint.
    energy_imbalance
        Largest |energy - work of loads - work of drivers + dissipated energy - initial energy|
        relative to the energy exchanged [-]. The energy exchanged is the largest of the kinetic
        energy, the range of the strain energy (with springs and the potentials of force laws), the
        range of the potential of gravity, and the magnitudes of the works. It is at least the
        rounding noise: 1e-8 times the largest force times the length of the mechanism, plus 1e-11
        times the largest energy.
    """

    max_residual: float
    max_position_drift: float
    max_velocity_drift: float
    energy_imbalance: float


@read_only_data
@dataclass(frozen=True, eq=False)
class EnergyLedger:
    """Energies, works and accuracy norms of a run.

    Attributes
    ----------
    trajectory
        The run, without states if only some of its steps are stored.
    length
        Length of the mechanism [m].
    energies, powers, norms
        Energies (k, 3) [J], powers (k, 3) [W] and norms (k, 5) at the k nodes of an interval, one
        array per interval; see `measures.plan_balance`.
    works
        Works (steps + 1, 3) [J] from the start of the run to the times `Interval.t`, one array per
        interval.
    """

    trajectory: Trajectory
    length: float
    energies: tuple[Array, ...]
    powers: tuple[Array, ...]
    norms: tuple[Array, ...]
    works: tuple[Array, ...]

    @classmethod
    def of(cls, equations: EquationsOfMotion, trajectory: Trajectory) -> EnergyLedger:
        """Evaluate the energies of a run at all nodes and integrate the powers."""
        functions: dict[int, measures.BalanceRows] = {}
        rows: list[tuple[Array, ...]] = []
        works: list[Array] = []
        work, previous = np.zeros(3), None
        for interval in trajectory.intervals:
            configuration, state = interval.configuration, interval.rows
            active = interval.active_equations(equations)
            if configuration is not None:
                state = state._replace(lam=configuration.select_multipliers(state.lam))
            if interval.record is not None:
                values = interval.record.values
            else:
                if id(active) not in functions:
                    functions[id(active)] = measures.BalanceRows(active)
                values = functions[id(active)](interval.times, *state)
            energies, powers, norms = map(np.ascontiguousarray, np.split(values, [3, 6], axis=1))
            if rows:
                jump = energies[0] - rows[-1][0][-1]
                if configuration is previous:
                    # The rate of a driver jumps at a breakpoint, and the velocities jump with it.
                    work = work + np.array([0.0, jump[0], 0.0])
                else:
                    # Impacts and activated joints dissipate energy, and the energy stored in
                    # deactivated springs is lost.
                    work = work - np.array([0.0, 0.0, jump.sum()])
            previous = configuration
            rows.append((energies, powers, norms))
            works.append(work + interval.grid.integrate_to_steps(powers))
            work = works[-1][-1]
        all_energies, all_powers, all_norms = zip(*rows, strict=True)
        steps = Trajectory(tuple(interval.grid for interval in trajectory.intervals))
        return cls(steps, equations.length, all_energies, all_powers, all_norms, tuple(works))

    def at(self, times: Array) -> Array:
        """Return the ledger (k, 7) at ascending times (k,) [s].

        The columns are `measures.LEDGER_COLUMNS` [J].
        """
        index = self.trajectory.interval_index(times)
        rows = np.concatenate(
            [self._interpolate(k, times[index == k]) for k in range(len(self.energies))]
        )
        start = np.append(self.energies[0][0], np.zeros(3))
        return np.column_stack([rows, _sum_balance(rows, start)])

    def _interpolate(self, k: int, times: Array) -> Array:
        """Return energies and works (len(times), 6) [J] at times inside the interval `k`."""
        interval = self.trajectory.intervals[k]
        step = interval.find_steps(times)
        if step is not None:
            energies = self.energies[k][step * interval.nodes_per_step]
            return np.hstack([energies, self.works[k][step]])
        works = interval.integrate_to(times, self.powers[k], self.works[k])
        return np.hstack([interval.interpolate(self.energies[k], times), works])

    @property
    def largest_force(self) -> float:
        """Largest absolute entry of G^T lam and of F at a = 0."""
        _, reaction, force, _, _ = self._largest_norms
        return max(reaction, force)

    @cached_property
    def quality(self) -> Quality:
        """Largest residual, drift and energy imbalance over the steps."""
        # Energies and works (steps + 1, 6) [J] at all steps.
        rows = np.hstack([self._select_steps(self.energies), np.concatenate(self.works)])
        # The datum of a potential is arbitrary, and an attractive potential is negative. For
        # potentials, the energy exchanged is therefore the range.
        kinetic, works = rows[:, 0], rows[:, 3:]
        # One column at a time: NumPy takes ten times as long along rows of two numbers.
        potentials = np.max([np.ptp(rows[:, k]) for k in (1, 2)])
        exchanged = float(max(np.max(kinetic), potentials, np.max(np.abs(works))))
        imbalance = float(np.max(np.abs(_sum_balance(rows, rows[0]))))
        rounding = (
            _ROUNDING_OF_FORCES * self.largest_force * self.length
            + _ROUNDING_OF_ENERGIES * float(np.max(np.abs(rows)))
        )
        residual, _, _, position, velocity = self._largest_norms
        return Quality(
            residual / max(self.largest_force, _TINY),
            position,
            velocity,
            imbalance / max(exchanged, rounding, _TINY),
        )

    @cached_property
    def _largest_norms(self) -> list[float]:
        columns = np.ascontiguousarray(self._select_steps(self.norms).T)
        # Unbounded reactions are NaN, see `integrators.reaction_balance`.
        return [float(x) for x in np.fmax.reduce(columns, axis=1)]

    def _select_steps(self, values: tuple[Array, ...]) -> Array:
        """Select the rows at the steps from rows at the nodes of each interval."""
        intervals = self.trajectory.intervals
        return np.concatenate(
            [x[:: i.nodes_per_step] for x, i in zip(values, intervals, strict=True)]
        )


def _sum_balance(rows: Array, start: Array) -> Array:
    """Return the imbalance [J] of each row of energies and works, relative to the row `start`."""
    return (rows[:, :6] - start[:6]) @ _BALANCE_SIGNS
