"""Small vibrations of a mechanism at rest under constant loads that appear at once, by modes."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, null_space

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver


def solve_small_vibrations(mechanism: bd.Mechanism, times: np.ndarray) -> dict[str, np.ndarray]:
    """Observed columns by name at `times`, linear in the loads.

    The equations are linearized about the unloaded drawing, M x'' + D x' + K x = f under G x = 0,
    and each mode follows x = f / w^2 (1 + (r2 exp(r1 t) - r1 exp(r2 t)) / (r1 - r2)) with r1 and r2
    the roots of r^2 + d r + w^2 = 0. Damping must be proportional, and no body free to move.
    """
    e = bd.equations_of_motion(mechanism)
    starter, start = ConsistencySolver(e), np.zeros(2)
    rest = State(e.q0, np.zeros(e.n), np.zeros(e.n), np.zeros(e.m))
    stiffness, damping, mass = (m.toarray() for m in starter.linearize_forces(start, rest))
    load = -starter.force(start, rest.q, rest.v, np.zeros(e.n))
    g = starter.constraint_matrix(start, rest.q).toarray()

    free = null_space(g)
    squares, modes = eigh(free.T @ stiffness @ free, free.T @ mass @ free)
    modes = free @ modes
    rates = np.einsum("ij,ij->j", modes, damping @ modes)
    root = np.sqrt((0.25 * rates**2 - squares).astype(complex))
    r1, r2 = -0.5 * rates + root, -0.5 * rates - root
    grown = [np.exp(np.outer(times, r)) for r in (r1, r2)]
    size = (modes.T @ load) / squares
    amplitude = size * (1.0 + (r2 * grown[0] - r1 * grown[1]) / (r1 - r2)).real
    rate = size * (squares * (grown[0] - grown[1]) / (r1 - r2)).real
    acceleration = size * (squares * (r1 * grown[0] - r2 * grown[1]) / (r1 - r2)).real

    x, v, a = (k @ modes.T for k in (amplitude, rate, acceleration))
    force = a @ mass.T + v @ damping.T + x @ stiffness.T - load
    lam = -np.linalg.lstsq(g.T, force.T, rcond=None)[0].T
    clock = np.stack([times, times], axis=-1)
    rows = measures.ObservedRows(e)(clock, e.q0 + x, v, a, lam)
    headers = [header for quantity in e.observables for header in quantity.headers]
    return dict(zip(headers, rows.T, strict=True))
