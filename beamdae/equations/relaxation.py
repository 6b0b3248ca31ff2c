"""Equilibrium from afar: down the gradient flow of a mechanism, to where it can rest."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.consistent_start import Starter
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Steps that keep Newton's iteration near the joints, in the natural sizes of coordinates; of what
# went further than its size, in that way, for so many sizes.
_APPROACH, _FURTHER = 0.2, 1e4
# Pseudo-time squared [s^2] of the way to equilibrium: where it begins, ends, and its growth.
_FIRST, _LAST, _GROWTH = 1e-4, 1e8, 4.0
_STEADY, _MOST_STEPS = 1e-10, 400


class AtRest(Protocol):
    """Static equations of (q, lam), such as `StaticEquations`."""

    @property
    def equations(self) -> EquationsOfMotion:
        """The equations of motion, whose inertia they share."""

    @property
    def time(self) -> Array:
        """(t, branch)."""

    def residual(self, q: Array, lam: Array) -> Array:
        """What has to vanish, (n + m,)."""

    def matrix(self, q: Array, lam: Array) -> sp.csc_array:
        """Its derivative by (q, lam)."""


def relaxed(static: AtRest, q: Array) -> tuple[Array, Array]:
    """Positions and multipliers at rest: implicit steps down the gradient flow from near `q`.

    The steps solve [[M / T^2 + K, G^T], [G, 0]] with K that of F + G^T lam, and end as Newton's
    method: short pseudo-times T keep a step small and lead to equilibria that are stable, long ones
    converge quadratically.

    Raises
    ------
    BeamdaeError
        If nothing comes to rest, naming the coordinate that moved most.
    """
    e, time = static.equations, static.time
    starter, n, scale = Starter(e), e.n, e.position_scales
    turns = np.array([coordinate.unit == "rad" for coordinate in e.coordinates])
    begin = starter.state(time, q, np.zeros(n))
    q, lam, square = begin.q, begin.lam, _FIRST
    for _ in range(_MOST_STEPS):
        mass = starter.linearized(time, starter.at_rest(q))[2]
        weight = sp.block_diag([mass / square, sp.csc_array((e.m, e.m))], format="csc")
        try:
            matrix = sp.csc_array(static.matrix(q, lam) + weight)
            change = -splu(matrix).solve(static.residual(q, lam))
        except RuntimeError:
            change = np.full(n + e.m, np.nan)
        way = np.where(turns, 0.0, np.minimum(np.abs(q - begin.q), _FURTHER * scale))
        far = float(np.max(np.abs(change[:n]) / (scale + way)))
        if not far <= _APPROACH:
            square /= _GROWTH
            if square < 1e-30:
                break
            continue
        q, lam = q + change[:n], lam + change[n:]
        if far < _STEADY and square >= _LAST:
            return q, lam
        square = min(square * _GROWTH, _LAST)
    moved = np.abs(q - begin.q) / scale
    worst = int(np.argmax(moved))
    raise BeamdaeError(
        f"{e.q_names[worst]}: no equilibrium was found, this coordinate moves without end under "
        f"the loads at t = {time[0]:g} s, it was {moved[worst] * scale[worst]:.3g} away when the "
        "search was given up; hold it by a joint or a spring."
    )
