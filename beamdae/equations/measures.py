"""What results measure of a run, as functions of its states: one row a state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.sums import N_BALANCE_SCALARS, InputLayout, assemble_balance
from beamdae.equations.structure import Structure, cache_on_owner
from beamdae.native.loop_functions import combine, max_norm
from beamdae.native.loops import prepare_loop
from beamdae.native.return_codes import DONE
from beamdae.symbolic.kernel_sums import Sum, SumPlan, evaluate_sum

Array = np.ndarray

# States whose books are kept at once: as many as stay in the caches.
_NUMBERS_AT_ONCE, _ROWS_AT_ONCE = 100_000, 1024

ENERGIES = ("kinetic", "strain", "gravity")
WORKS = ("work of loads", "work of drivers", "dissipated")
_N_NORMS = 5
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
class BalancePlan:
    """What keeps the books of a run, see `plan_balance`.

    Attributes
    ----------
    n, m
        Numbers of coordinates and constraints.
    total
        `assemble_balance` of (q, v, a, lam).
    """

    n: int
    m: int
    total: SumPlan

    def rows(self, p: Array) -> BalanceRows:
        """What evaluates it at rows of states, with the numbers of a model, for one run alone."""
        return BalanceRows(self, p)

    def buffers(self, native: bool, p: Array) -> BalanceBuffers:
        """What `evaluate_balance` works on."""
        size = 3 * self.n + self.m
        rows = int(np.clip(_NUMBERS_AT_ONCE // max(size, 1), 1, _ROWS_AT_ONCE))
        return BalanceBuffers(
            self.total.sum(native, p),
            self.n,
            self.m,
            times=np.zeros((rows, 2)),
            states=np.zeros((rows, size)),
            found=np.zeros((rows, N_BALANCE_SCALARS + _N_NORMS)),
            value=np.zeros(N_BALANCE_SCALARS + size + self.m),
            ones=np.ones(max(self.n, self.m)),
        )


@dataclass(slots=True)
class BalanceBuffers:
    """Rows of a run whose books are kept.

    Attributes
    ----------
    total, n, m
        See `BalancePlan`.
    times, states
        (t, branch) and (q, v, a, lam) of the rows.
    found
        Energies, powers and norms of the rows.
    value, ones
        The sum at one of them, and weights of its norms.
    filled
        How many rows there are.
    """

    total: Sum
    n: int
    m: int
    times: Array
    states: Array
    found: Array
    value: Array
    ones: Array
    filled: int = 0


def evaluate_balance(run: BalanceBuffers) -> int:
    """Energies, powers and norms of all rows there are."""
    n, m, value = run.n, run.m, run.value
    on_q, on_g = run.ones[:n], run.ones[:m]
    levels = N_BALANCE_SCALARS + 3 * n
    for i in range(run.filled):
        combine(run.total.shared, (1.0,), (run.times[i],))
        evaluate_sum(run.total, run.states[i], value)
        row = run.found[i]
        combine(row[:N_BALANCE_SCALARS], (1.0,), (value[:N_BALANCE_SCALARS],))
        for k in range(3):
            row[N_BALANCE_SCALARS + k] = max_norm(
                value[N_BALANCE_SCALARS + k * n : N_BALANCE_SCALARS + (k + 1) * n], on_q
            )
        for k in range(2):
            row[N_BALANCE_SCALARS + 3 + k] = max_norm(
                value[levels + k * m : levels + (k + 1) * m], on_g
            )
    return DONE


class BalanceRows:
    """Keeps the books of one run, in machine code where that can be had."""

    def __init__(self, balance: BalancePlan, p: Array) -> None:
        self._run, self._loop = prepare_loop(
            evaluate_balance, lambda native: balance.buffers(native, p), balance.total.is_native
        )

    def __call__(self, times: Array, *state: Array) -> Array:
        """Rows (energies, powers, norms) of states (q, v, a, lam) at (t, branch)."""
        run, found = self._run, np.empty((len(times), self._run.found.shape[1]))
        ends = np.cumsum([x.shape[1] for x in state])[:-1]
        columns = np.split(run.states, ends, axis=1)
        # In between Python hears of Ctrl-C.
        for first in range(0, len(times), len(run.times)):
            some = slice(first, first + len(run.times))
            run.filled = len(times[some])
            run.times[: run.filled] = times[some]
            for column, x in zip(columns, state, strict=True):
                column[: run.filled] = x[some]
            self._keep()
            found[some] = run.found[: run.filled]
        return found

    def _keep(self) -> None:
        if self._loop is not None:
            self._loop()
            return
        # Forces beyond all numbers are told of by their norms.
        with np.errstate(over="ignore", invalid="ignore"):
            evaluate_balance(self._run)


@cache_on_owner
def plan_balance(e: Structure) -> BalancePlan:
    """(3) `ENERGIES` [J], (3) powers of `WORKS` [W], and what shows how good a state is.

    The latter are the largest entries of F + G^T lam, G^T lam, F at a = 0, g and g_dot.
    """
    at = InputLayout(q=0, v=e.n, a=2 * e.n, lam=3 * e.n)
    return BalancePlan(e.n, e.m, assemble_balance(e, at).vector())


def balance_rows(equations: EquationsOfMotion) -> BalanceRows:
    """Rows (energies, powers, norms) at rows of states, see `plan_balance`; for one run alone."""
    return plan_balance(equations.structure).rows(equations.p)
