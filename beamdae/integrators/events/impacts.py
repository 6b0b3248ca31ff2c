"""Impacts: velocities that jump by Newton's restitution, within all joints that hold."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.assembly.configurations import ImpactEquations
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver

Array = np.ndarray


def solve_impulses(
    names: tuple[str, ...], mass: sp.csc_array, gradient: sp.csc_array, rates: Array
) -> tuple[Array, Mapping[str, float]]:
    """The change of velocities that changes the rates of constraints, and its impulses by name.

    M (v+ - v-) = -G^T P, G (v+ - v-) = `rates`.
    """
    n, m = mass.shape[0], len(rates)
    if not m or not np.any(rates):
        return np.zeros(n), dict.fromkeys(names, 0.0)
    saddle = sp.block_array([[mass, gradient.T], [gradient, None]], format="csc")
    found = splu(saddle).solve(np.concatenate([np.zeros(n), rates]))
    return found[:n], dict(zip(names, found[n:].tolist(), strict=True))


def apply_impact(
    struck: ImpactEquations, time: Array, state: State
) -> tuple[Array, Mapping[str, float]]:
    """Velocities after an impact at time = (t, branch), and its impulses by multiplier.

    Raises
    ------
    BeamdaeError
        If joints do not leave what is struck any motion.
    """
    e, starter = struck.equations, ConsistencySolver(struck.equations)
    rates = starter.constraint_levels(time, state.q, state.v)[1]
    restitution = np.array([struck.restitution.get(name, 0.0) for name in e.lam_names])
    opens = np.array([name in struck.gaps for name in e.lam_names]) & (rates <= 0.0)
    (held,) = np.nonzero(~opens)
    if not any(e.lam_names[k] in struck.restitution for k in held):
        return state.v, {}
    starter.require_independent(time, state.q)
    own = State(state.q, state.v, np.zeros(e.n), np.zeros(e.m))
    gradient = sp.csc_array(starter.constraint_matrix(time, state.q)[held])
    change, impulses = solve_impulses(
        tuple(e.lam_names[k] for k in held),
        starter.linearize_forces(time, own)[2],
        gradient,
        -(1.0 + restitution[held]) * rates[held],
    )
    return state.v + change, impulses
