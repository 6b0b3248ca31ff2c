"""What results measure of a run, as functions of its states: one row a state."""

from __future__ import annotations

import casadi as ca

from beamdae.equations.equations_of_motion import EquationsOfMotion, once
from beamdae.symbolic.compiled import RowFunction

MX = ca.MX

ENERGIES = ("kinetic", "strain", "gravity")
WORKS = ("work of loads", "work of drivers", "dissipated")
# What tables hold besides the observed columns.
TIME = "t [s]"
LEDGER_COLUMNS = tuple(
    f"energy.{name.replace(' ', '_')} [J]" for name in (*ENERGIES, *WORKS, "imbalance")
)
DRIFT_COLUMNS = ("drift.position", "drift.velocity")


def _symbols(e: EquationsOfMotion) -> tuple[MX, ...]:
    """(time, q, v, a, p, lam), the arguments of every function here."""
    vectors = (MX.sym(name, e.n) for name in ("q", "v", "a"))
    return (MX.sym("time", 2), *vectors, MX.sym("p", len(e.p)), MX.sym("lam", e.m))


@once
def observed(e: EquationsOfMotion) -> RowFunction:
    """All observed columns, in the order of `observables`."""
    symbols = _symbols(e)
    time, q, v, _, p, lam = symbols
    return _of_rows("observed", symbols, e.observed(time, q, v, p, lam))


@once
def balance(e: EquationsOfMotion) -> RowFunction:
    """(3) `ENERGIES` [J], (3) powers of `WORKS` [W], and what shows how good a state is.

    The latter are the largest entries of F + G^T lam, G^T lam, F at a = 0, g and g_dot.
    """
    symbols = _symbols(e)
    time, q, v, a, p, lam = symbols
    energies = e.energies(time, q, v, p)
    reaction, force = e.reaction(time, q, p, lam), e.force(time, q, v, a, p)
    norms = ca.vertcat(
        _largest(force + reaction),
        _largest(reaction),
        _largest(e.force(time, q, v, MX.zeros(e.n), p)),
        _largest(e.level(0, time, q, v, a, p)),
        _largest(e.level(1, time, q, v, a, p)),
    )
    power = ca.vertcat(energies[3], e.driver_power(time, q, p, lam), energies[4])
    return _of_rows("balance", symbols, ca.vertcat(energies[:3], power, norms))


@once
def drift(e: EquationsOfMotion) -> RowFunction:
    """Largest |g| and |g_dot|."""
    symbols = _symbols(e)
    levels = [_largest(e.level(k, *symbols[:5])) for k in (0, 1)]
    return _of_rows("drift", symbols, ca.vertcat(*levels))


def _largest(x: MX) -> MX:
    return ca.norm_inf(x) if x.numel() else MX(0)


def _of_rows(name: str, symbols: tuple[MX, ...], value: MX) -> RowFunction:
    return RowFunction(ca.Function(name, list(symbols), ca.cse([ca.densify(value)])))
