"""Observed columns and energy balance of a run, evaluated at rows of states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from beamdae.core.library import load_core
from beamdae.core.tables import Loop
from beamdae.equations.formulations.sums import N_BALANCE_SCALARS, InputLayout, assemble_balance
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan, evaluate_sum

if TYPE_CHECKING:
    from beamdae.equations.equations_of_motion import EquationsOfMotion

Array = np.ndarray

# Limits of the rows evaluated together, so that their data stay in the processor caches.
_MAX_NUMBERS_AT_ONCE = 100_000
_MAX_ROWS_AT_ONCE = 1024

ENERGIES = ("kinetic", "strain", "gravity")
WORKS = ("work of loads", "work of drivers", "dissipated")
_N_FORCE_NORMS = 3  # of F + G^T lam, G^T lam and F at a = 0
_N_GAP_NORMS = 2  # of g and g_dot
N_BALANCE_VALUES = N_BALANCE_SCALARS + _N_FORCE_NORMS + _N_GAP_NORMS

# Headers of tables besides the observed columns.
TIME = "t [s]"
LEDGER_COLUMNS = tuple(
    f"energy.{name.replace(' ', '_')} [J]" for name in (*ENERGIES, *WORKS, "imbalance")
)
DRIFT_COLUMNS = ("drift.position", "drift.velocity")


@dataclass(frozen=True)
class ObservedRows:
    """Evaluates all observed columns, in the order of `observables`."""

    equations: EquationsOfMotion

    def __call__(self, times: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
        """Return rows of the columns, given rows of (t, branch) and of states (q, v, a, lam)."""
        e, blocks = self.equations, [np.zeros((len(times), 0))]
        used, operator = _stack_operators([o.operator for o in e.observables])
        # Copied once: SciPy would copy all columns of all coordinates in each product.
        local = [np.asarray(operator @ np.ascontiguousarray(x.T[used])) for x in (q, v)]
        first = 0
        for o in e.observables:
            here = slice(first, first + o.operator.shape[0])
            accelerations = [np.asarray(o.operator @ a.T).T] if o.has_accelerations else []
            arguments = (*(x[here].T for x in local), e.p[o.data], lam[:, o.rows], *accelerations)
            blocks.append(o.function(times, *arguments))
            first = here.stop
        return np.hstack(blocks)


def _stack_operators(matrices: Sequence[sp.csr_array]) -> tuple[Array, sp.csr_array]:
    """Return the indices of the coordinates in use, and all operators as one on these."""
    if not matrices:
        return np.zeros(0, np.intp), sp.csr_array((0, 0))
    used, indices = np.unique(np.concatenate([x.indices for x in matrices]), return_inverse=True)
    lengths = np.concatenate([np.diff(x.indptr) for x in matrices])
    ends = np.concatenate([[0], np.cumsum(lengths)])
    data = np.concatenate([x.data for x in matrices])
    return used, sp.csr_array((data, indices, ends), shape=(len(lengths), len(used)))


@dataclass(frozen=True)
class BalancePlan:
    """Plan for the evaluation of energies, powers and norms, see `plan_balance`.

    Attributes
    ----------
    n, m
        Numbers of coordinates and constraints.
    total
        Plan of the sum built by `assemble_balance`; the input is (q, v, a, lam).
    states
        Indices of the coordinates of first-order states, whose rows of F are no forces.
    """

    n: int
    m: int
    total: SumPlan
    states: tuple[int, ...]

    def buffers(self, native: bool, p: Array) -> BalanceBuffers:
        """Return the buffers of `evaluate_balance` for a model with the numbers p."""
        size = 3 * self.n + self.m
        rows = int(np.clip(_MAX_NUMBERS_AT_ONCE // max(size, 1), 1, _MAX_ROWS_AT_ONCE))
        is_force = np.ones(self.n)
        is_force[list(self.states)] = 0.0
        return BalanceBuffers(
            self.total.sum(native, p),
            self.n,
            self.m,
            times=np.zeros((rows, 2)),
            states=np.zeros((rows, size)),
            results=np.zeros((rows, N_BALANCE_VALUES)),
            value=np.zeros(N_BALANCE_SCALARS + size + self.m),
            is_force=is_force,
            ones=np.ones(self.m),
        )


@dataclass(slots=True)
class BalanceBuffers:
    """Rows of states and their energies, powers and norms, see `plan_balance`.

    Attributes
    ----------
    total
        Sum of which `BalancePlan.total` is the plan.
    n, m
        Numbers of coordinates and constraints.
    times, states
        (t, branch) and (q, v, a, lam) of the rows.
    results
        Energies, powers and norms of the rows.
    value
        Values of the sum at one row.
    is_force, ones
        Weights of the norms: 1 for rows of F that are forces, 0 for those of first-order states;
        and 1 for constraints.
    n_rows
        Number of rows in use.
    """

    total: Sum
    n: int
    m: int
    times: Array
    states: Array
    results: Array
    value: Array
    is_force: Array
    ones: Array
    n_rows: int = 0


class BalanceRows:
    """Evaluates the energy balance of one run, in machine code if available."""

    def __init__(self, balance: BalancePlan, p: Array) -> None:
        self._run = balance.buffers(balance.total.is_native, p)
        self._loop = None if load_core() is None else Loop("evaluate_balance", self._run)

    def __call__(self, times: Array, *state: Array) -> Array:
        """Return rows (energies, powers, norms) of states (q, v, a, lam) at (t, branch)."""
        run, results = self._run, np.empty((len(times), self._run.results.shape[1]))
        ends = np.cumsum([x.shape[1] for x in state])[:-1]
        columns = np.split(run.states, ends, axis=1)
        # Ctrl-C takes effect between two blocks of rows.
        for first in range(0, len(times), len(run.times)):
            block = slice(first, first + len(run.times))
            run.n_rows = len(times[block])
            run.times[: run.n_rows] = times[block]
            for column, x in zip(columns, state, strict=True):
                column[: run.n_rows] = x[block]
            if self._loop is not None:
                self._loop()
            else:
                _evaluate_balance(run)
            results[block] = run.results[: run.n_rows]
        return results


# Overflowing forces show in the norms.
@np.errstate(over="ignore", invalid="ignore")
def _evaluate_balance(run: BalanceBuffers) -> None:
    """Evaluate the rows in use without the core."""
    n, m = run.n, run.m
    for time, state, result in zip(run.times, run.states, run.results[: run.n_rows], strict=False):
        run.total.shared[:] = time
        evaluate_sum(run.total, state, run.value)
        scalars, forces, gaps = np.split(
            run.value, np.cumsum([N_BALANCE_SCALARS, _N_FORCE_NORMS * n])
        )
        norms = [
            np.abs(forces.reshape(_N_FORCE_NORMS, n) * run.is_force),
            np.abs(gaps.reshape(_N_GAP_NORMS, m)),
        ]
        result[:] = np.concatenate([scalars, *(np.max(x, axis=1, initial=0.0) for x in norms)])


@cache_on_owner
def plan_balance(e: Structure) -> BalancePlan:
    """Return the plan that evaluates three energies [J], three powers [W] and five norms.

    `ENERGIES` names the energies; `WORKS` names the time integrals of the powers. The norms are the
    largest absolute entries of F + G^T lam, G^T lam, F at a = 0, g and g_dot, without the rows of
    first-order states.
    """
    layout = InputLayout(q=0, v=e.n, a=2 * e.n, lam=3 * e.n)
    return BalancePlan(e.n, e.m, assemble_balance(e, layout).vector(), e.states)


def balance_rows(equations: EquationsOfMotion) -> BalanceRows:
    """Return an evaluator of rows (energies, powers, norms) for one run, see `plan_balance`."""
    return BalanceRows(plan_balance(equations.structure), equations.p)
