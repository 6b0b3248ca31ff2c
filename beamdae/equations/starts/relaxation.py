"""Equilibrium from afar: down the gradient flow of a mechanism, to where it can rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.displacement_measure import DisplacementMeasure
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Steps that keep Newton's iteration near the joints, in the natural sizes of coordinates; of what
# went further than its size, in that way, for so many sizes.
_APPROACH, _FURTHER = 0.2, 1e4
# How far joints may be closed after a step, as a share of it; what is less than that is none.
_LEFT, _NONE = 0.5, 1e-9
# Pseudo-times squared of the way to equilibrium: how far the accelerations at the beginning carry
# in the first, the last over the first, and from step to step.
_FIRST, _LAST, _GROWTH = 0.01, 1e11, 4.0
# How far rounding may carry in a step, from positions that are off by so much.
_CARRIED, _OFF = 1e-9, 1e-14
_STEADY, _MOST_STEPS = 1e-10, 400


class StaticSystem(Protocol):
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


class FlowStep(NamedTuple):
    """A step of the gradient flow that is tried: `q` and `lam` where it ends.

    Attributes
    ----------
    far
        How far it goes, in natural sizes.
    left
        How far joints are closed after it, by one more iteration.
    carried
        How far rounding may have carried it: far where nothing resists.
    """

    q: Array
    lam: Array
    far: float
    left: float
    carried: float

    @property
    def is_near(self) -> bool:
        """Whether the joints are to be trusted in it."""
        return self.far <= _APPROACH and self.left <= max(_LEFT * self.far, _NONE)

    @property
    def is_steady(self) -> bool:
        """Whether it goes nowhere but for rounding."""
        return self.far <= max(_STEADY, 100.0 * self.carried) and self.carried <= 10.0 * _CARRIED


@dataclass(frozen=True)
class GradientFlow:
    """Implicit steps down the gradient flow of a mechanism that began at positions `begun`."""

    static: StaticSystem
    begun: Array
    starter: ConsistencySolver
    travel: DisplacementMeasure

    @cached_property
    def _turns(self) -> Array:
        return np.array([x.unit == "rad" for x in self.static.equations.coordinates], bool)

    @cached_property
    def _off(self) -> Array:
        signs = np.random.default_rng(0).choice([-1.0, 1.0], len(self.begun))
        return _OFF * self.travel.scale * signs

    def step(self, q: Array, lam: Array, square: float) -> FlowStep | None:
        """One of a pseudo-time T, T^2 = `square`; None where nothing is to be had."""
        static, n, m = self.static, len(q), len(lam)
        mass = self.starter.linearize_forces(static.time, self.starter.rest_state(q))[2]
        weight = sp.block_diag([mass / square, sp.csc_array((m, m))], format="csc")
        try:
            solve = splu(sp.csc_array(static.matrix(q, lam) + weight)).solve
        except RuntimeError:
            return None
        way = np.minimum(self.travel.distances(q - self.begun), _FURTHER * self.travel.scale)
        sizes = self.travel.scale + np.where(self._turns, 0.0, way)

        def size(change: Array) -> float:
            return float(np.max(self.travel.distances(change[:n]) / sizes))

        there = static.residual(q, lam)
        change = -solve(there)
        far = size(change)
        if not far <= _APPROACH:
            return None
        rounded = size(solve(static.residual(q + self._off, lam) - there))
        q, lam = q + change[:n], lam + change[n:]
        open_joints = static.residual(q, lam)
        open_joints[:n] = 0.0
        further = -solve(open_joints)
        return FlowStep(q + further[:n], lam + further[n:], far, size(further), rounded)


def relax_to_equilibrium(static: StaticSystem, q: Array) -> tuple[Array, Array]:
    """Positions and multipliers at rest: implicit steps down the gradient flow from near `q`.

    The steps solve [[M / T^2 + K, G^T], [G, 0]] with K that of F + G^T lam, once more to close the
    joints, and end as Newton's method: short pseudo-times T keep a step small and lead to
    equilibria that are stable, long ones converge quadratically. Steps are measured such that they
    are the same however the mechanism is turned, and in other units.

    Raises
    ------
    BeamdaeError
        If nothing comes to rest, naming the coordinate that moved most.
    """
    e, starter = static.equations, ConsistencySolver(static.equations)
    begin = starter.state(static.time, q, np.zeros(e.n))
    flow = GradientFlow(static, begin.q, starter, DisplacementMeasure.of(e))
    q, lam = begin.q, begin.lam
    fastest = flow.travel.farthest(begin.a)
    if _is_unloaded(static, q) or fastest == 0.0:
        return q, np.zeros(e.m)
    square = first = _FIRST / fastest
    for _ in range(_MOST_STEPS):
        step = flow.step(q, lam, square)
        if step is None or not step.is_near:
            square /= _GROWTH
            if square < 1e-26 * first:
                break
            continue
        q, lam = step.q, step.lam
        if step.is_steady and (square >= _LAST * first or step.carried > _CARRIED):
            return q, np.zeros(e.m) if _is_unloaded(static, q) else lam
        if step.carried <= _CARRIED:
            square = min(square * _GROWTH, _LAST * first)
        elif step.carried > 10.0 * _CARRIED:
            square /= _GROWTH
    moved = np.abs(q - begin.q)
    worst = int(np.argmax(moved / e.position_scales))
    raise BeamdaeError(
        f"{e.q_names[worst]}: no equilibrium was found, this coordinate moves without end under "
        f"the loads at t = {static.time[0]:g} s, it was {moved[worst]:.3g} away when the search "
        "was given up; hold it by a joint or a spring."
    )


def _is_unloaded(static: StaticSystem, q: Array) -> bool:
    """Whether there are no forces at all: joints that rounding opens bear nothing."""
    e = static.equations
    return not np.any(static.residual(q, np.zeros(e.m))[: e.n])
