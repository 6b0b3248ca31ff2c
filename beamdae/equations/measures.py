"""What results measure of a run, as functions of its states: one row a state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import Structure, once
from beamdae.equations.sums import BOOKED, Places, balance_sum
from beamdae.linear.return_codes import DONE
from beamdae.native.loops import prepared
from beamdae.native.vectors import combine, largest
from beamdae.symbolic.kernel_sums import Sum, SumPlan, evaluate

Array = np.ndarray

# States whose books are kept at once: as many as stay in the caches.
_NUMBERS_AT_ONCE, _ROWS_AT_ONCE = 100_000, 1024

ENERGIES = ("kinetic", "strain", "gravity")
WORKS = ("work of loads", "work of drivers", "dissipated")
_NORMS = 5
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
class Balance:
    """What keeps the books of a run, see `balance`.

    Attributes
    ----------
    n, m
        Numbers of coordinates and constraints.
    total
        `balance_sum` of (q, v, a, lam).
    """

    n: int
    m: int
    total: SumPlan

    def rows(self, p: Array) -> BalanceRows:
        """What evaluates it at rows of states, with the numbers of a model, for one run alone."""
        return BalanceRows(self, p)

    def buffers(self, native: bool, p: Array) -> BalanceRun:
        """What `keep_books` works on."""
        size = 3 * self.n + self.m
        rows = int(np.clip(_NUMBERS_AT_ONCE // max(size, 1), 1, _ROWS_AT_ONCE))
        return BalanceRun(
            self.total.sum(native, p),
            self.n,
            self.m,
            times=np.zeros((rows, 2)),
            states=np.zeros((rows, size)),
            found=np.zeros((rows, BOOKED + _NORMS)),
            value=np.zeros(BOOKED + size + self.m),
            ones=np.ones(max(self.n, self.m)),
        )


@dataclass(slots=True)
class BalanceRun:
    """Rows of a run whose books are kept.

    Attributes
    ----------
    total, n, m
        See `Balance`.
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


def keep_books(run: BalanceRun) -> int:
    """Energies, powers and norms of all rows there are."""
    n, m, value = run.n, run.m, run.value
    on_q, on_g = run.ones[:n], run.ones[:m]
    levels = BOOKED + 3 * n
    for i in range(run.filled):
        combine(run.total.shared, (1.0,), (run.times[i],))
        evaluate(run.total, run.states[i], value)
        row = run.found[i]
        combine(row[:BOOKED], (1.0,), (value[:BOOKED],))
        for k in range(3):
            row[BOOKED + k] = largest(value[BOOKED + k * n : BOOKED + (k + 1) * n], on_q)
        for k in range(2):
            row[BOOKED + 3 + k] = largest(value[levels + k * m : levels + (k + 1) * m], on_g)
    return DONE


class BalanceRows:
    """Keeps the books of one run, in machine code where that can be had."""

    def __init__(self, balance: Balance, p: Array) -> None:
        self._run, self._loop = prepared(
            keep_books, lambda native: balance.buffers(native, p), balance.total.is_native
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
            keep_books(self._run)


@once
def balance(e: Structure) -> Balance:
    """(3) `ENERGIES` [J], (3) powers of `WORKS` [W], and what shows how good a state is.

    The latter are the largest entries of F + G^T lam, G^T lam, F at a = 0, g and g_dot.
    """
    at = Places(q=0, v=e.n, a=2 * e.n, lam=3 * e.n)
    return Balance(e.n, e.m, balance_sum(e, at).vector())


def books_of(equations: EquationsOfMotion) -> BalanceRows:
    """Rows (energies, powers, norms) at rows of states, see `balance`; for one run alone."""
    return balance(equations.structure).rows(equations.p)
