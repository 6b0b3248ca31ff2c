"""Observed columns and energy balance of a run, evaluated at rows of states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from beamdae.core.library import load_core
from beamdae.core.tables import Loop, Workspace
from beamdae.equations.formulations.sums import N_BALANCE_SCALARS, InputLayout, assemble_balance
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.symbolic.sums.kernel_sums import SumPlan, evaluate_sum

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


class BalanceRows:
    """Evaluates the energy balance of one run, in machine code if available."""

    def __init__(self, equations: EquationsOfMotion) -> None:
        plan, n, m = plan_balance(equations.structure), equations.n, equations.m
        size = 3 * n + m
        rows = int(np.clip(_MAX_NUMBERS_AT_ONCE // max(size, 1), 1, _MAX_ROWS_AT_ONCE))
        self._run = Workspace(
            "BalanceBuffers",
            total=plan.sum(True, equations.p),
            n=n,
            m=m,
            times=np.zeros((rows, 2)),
            states=np.zeros((rows, size)),
            results=np.zeros((rows, N_BALANCE_VALUES)),
            value=np.zeros(N_BALANCE_SCALARS + size + m),
            is_force=equations.without_states(np.ones(n)),
            ones=np.ones(m),
        )
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
def _evaluate_balance(run: Workspace) -> None:
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
def plan_balance(e: Structure) -> SumPlan:
    """Return the plan that evaluates three energies [J], three powers [W] and five norms.

    `ENERGIES` names the energies; `WORKS` names the time integrals of the powers. The norms are the
    largest absolute entries of F + G^T lam, G^T lam, F at a = 0, g and g_dot, without the rows of
    first-order states.
    """
    layout = InputLayout(q=0, v=e.n, a=2 * e.n, lam=3 * e.n)
    return assemble_balance(e, layout).vector()
