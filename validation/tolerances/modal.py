"""Small vibrations of a mechanism after a step of constant loads, by modal superposition."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, null_space

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver


def solve_small_vibrations(mechanism: bd.Mechanism, times: np.ndarray) -> dict[str, np.ndarray]:
    """Return observed columns by name at `times`, to first order in the loads.

    The equations are linearized about the unloaded drawing, M x'' + D x' + K x = f under G x = 0,
    and each mode follows x = f / w^2 (1 + (r2 exp(r1 t) - r1 exp(r2 t)) / (r1 - r2)) with r1 and r2
    the roots of r^2 + d r + w^2 = 0. Damping must be proportional, and rigid-body modes are not
    supported.
    """
    e = bd.equations_of_motion(mechanism)
    solver, t = ConsistencySolver(e), np.zeros(2)
    rest = State(e.q0, np.zeros(e.n), np.zeros(e.n), np.zeros(e.m))
    stiffness, damping, mass = (m.toarray() for m in solver.linearize_forces(t, rest))
    load = -solver.force(t, rest.q, rest.v, np.zeros(e.n))
    g = solver.constraint_matrix(t, rest.q).toarray()

    free = null_space(g)
    squares, modes = eigh(free.T @ stiffness @ free, free.T @ mass @ free)
    modes = free @ modes
    rates = np.einsum("ij,ij->j", modes, damping @ modes)
    root = np.sqrt((0.25 * rates**2 - squares).astype(complex))
    r1, r2 = -0.5 * rates + root, -0.5 * rates - root
    exponentials = [np.exp(np.outer(times, r)) for r in (r1, r2)]
    deflection = (modes.T @ load) / squares
    amplitude = deflection * (1.0 + (r2 * exponentials[0] - r1 * exponentials[1]) / (r1 - r2)).real
    rate = deflection * (squares * (exponentials[0] - exponentials[1]) / (r1 - r2)).real
    acceleration = (
        deflection * (squares * (r1 * exponentials[0] - r2 * exponentials[1]) / (r1 - r2)).real
    )

    x, v, a = (k @ modes.T for k in (amplitude, rate, acceleration))
    force = a @ mass.T + v @ damping.T + x @ stiffness.T - load
    lam = -np.linalg.lstsq(g.T, force.T, rcond=None)[0].T
    time_rows = np.stack([times, times], axis=-1)
    rows = measures.ObservedRows(e)(time_rows, e.q0 + x, v, a, lam)
    headers = [header for quantity in e.observables for header in quantity.headers]
    return dict(zip(headers, rows.T, strict=True))
