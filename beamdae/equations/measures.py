"""What results measure of a run, as functions of its states: one row a state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import once
from beamdae.equations.sums import data_of, local_operator
from beamdae.symbolic.kernel_rows import KernelRows

Array = np.ndarray

# Of forces at rows of states, as many as stay in the caches.
_NUMBERS_AT_ONCE = 50000

ENERGIES = ("kinetic", "strain", "gravity")
WORKS = ("work of loads", "work of drivers", "dissipated")
# What tables hold besides the observed columns.
TIME = "t [s]"
LEDGER_COLUMNS = tuple(
    f"energy.{name.replace(' ', '_')} [J]" for name in (*ENERGIES, *WORKS, "imbalance")
)
DRIFT_COLUMNS = ("drift.position", "drift.velocity")


@dataclass(frozen=True)
class ObservedRows:
    """All observed columns, in the order of `observables`."""

    equations: EquationsOfMotion

    def __call__(self, times: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
        """Rows of the columns at states (q, v, a, lam) at (t, branch)."""
        e, found = self.equations, [np.zeros((len(times), 0))]
        for o in e.observables:
            local = (np.asarray(o.operator @ x.T).T for x in (q, v))
            found.append(o.function(times, *local, e.p[o.data], lam[:, o.rows]))
        return np.hstack(found)


@dataclass(frozen=True)
class BalanceRows:
    """What keeps the books of a run, see `balance`."""

    equations: EquationsOfMotion
    forces: tuple[KernelRows, ...]
    joints: tuple[KernelRows, ...]

    def __call__(self, times: Array, *state: Array) -> Array:
        """Rows (energies, powers, norms) of states (q, v, a, lam) at (t, branch)."""
        at_once = max(_NUMBERS_AT_ONCE // self.equations.n, 1)
        parts = (slice(i, i + at_once) for i in range(0, len(times), at_once))
        return np.concatenate([self._some(times[i], *(x[i] for x in state)) for i in parts])

    def _some(self, times: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
        e = self.equations
        force, still, reaction = (np.zeros((len(q), e.n)) for _ in range(3))
        energies, drivers = np.zeros((len(q), 5)), np.zeros(len(q))
        levels = [np.zeros((len(q), e.m)) for _ in range(2)]
        for term, rows in zip(e.forces, self.forces, strict=True):
            operator = rows.operators[0]
            own_force, own_still, own_energies = rows(times, (q, v, a))
            force += own_force @ operator
            still += own_still @ operator
            energies += own_energies.reshape(len(q), term.count, 5).sum(axis=1)
        for joint, rows in zip(e.joints, self.joints, strict=True):
            own_reaction, *own_levels, power = rows(times, (q, v, lam))
            reaction += own_reaction @ joint.operator
            for level, own in zip(levels, own_levels, strict=True):
                level += own @ joint.rows
            drivers += power.sum(axis=1)
        norms = [np.abs(x).max(axis=1, initial=0.0) for x in (force + reaction, reaction, still)]
        norms += [np.abs(x).max(axis=1, initial=0.0) for x in levels]
        return np.column_stack([energies[:, :3], energies[:, 3], drivers, energies[:, 4], *norms])


@once
def balance(e: EquationsOfMotion) -> BalanceRows:
    """(3) `ENERGIES` [J], (3) powers of `WORKS` [W], and what shows how good a state is.

    The latter are the largest entries of F + G^T lam, G^T lam, F at a = 0, g and g_dot.
    """
    forces = (
        KernelRows(t.kernel.balance_kernel, (local_operator(e, t),) * 3, data_of(e, t), t.count)
        for t in e.forces
    )
    joints = (
        KernelRows(
            t.kernel.balance_kernel, (t.operator, t.operator, t.rows), data_of(e, t), t.count
        )
        for t in e.joints
    )
    return BalanceRows(e, tuple(forces), tuple(joints))
