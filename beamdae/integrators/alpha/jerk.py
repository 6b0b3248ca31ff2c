"""What joints prescribe of the jerk of a motion, within loops of the generalized-alpha family.

Plain Python over arrays, as `alpha_loop`; `Starter.normal_jerk` is the same for the start of a run.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.start_sums import start_sums
from beamdae.equations.structure import Structure, once
from beamdae.equations.sums import Places, acceleration_sum
from beamdae.integrators.alpha.alpha_workspace import AlphaRun, Motion
from beamdae.integrators.compiled_run import Matrix
from beamdae.linear.return_codes import DONE
from beamdae.native.vectors import combine, factorize, fill, solve
from beamdae.symbolic.kernel_sums import Sum, SumPlan, evaluate

Array = np.ndarray


@once
def _accelerations_plan(structure: Structure) -> SumPlan:
    n = structure.n
    return acceleration_sum(structure, Places(q=0, v=n, a=2 * n, lam=3 * n)).vector()


@dataclass(frozen=True)
class JerkEquations:
    """What the jerk follows from; the saddle matrix is to be factorized for it."""

    equations: EquationsOfMotion
    accelerations: SumPlan
    saddle: SumPlan
    matrix: Matrix

    @classmethod
    def of(cls, equations: EquationsOfMotion) -> JerkEquations:
        """Those of a mechanism, for one run."""
        structure = equations.structure
        sums = start_sums(structure)
        plan, matrix = _accelerations_plan(structure), Matrix.of(sums.saddle_pattern)
        return cls(equations, plan, sums.saddle, matrix)

    @property
    def is_native(self) -> bool:
        """Whether they can be evaluated in machine code."""
        return self.accelerations.is_native and self.saddle.is_native

    def buffers(self, native: bool) -> NormalJerk:
        """What a loop finds the jerk with."""
        n, m, p = self.equations.n, self.equations.m, self.equations.p
        return NormalJerk(
            self.accelerations.sum(native, p),
            self.saddle.sum(native, p),
            self.matrix.linear(native, "auto"),
            np.zeros(3 * n + m),
            np.zeros(m),
            np.zeros(m),
            self.matrix.nonzeros,
            np.zeros(n + m),
        )


@dataclass(slots=True)
class NormalJerk:
    """What it is found with.

    Attributes
    ----------
    accelerations
        g_ddot of (q, v, a, lam).
    saddle, linear
        [[M, G^T], [G, 0]] of the same, and its factors.
    motion, ahead, behind, nonzeros
        (q, v, a, lam), g_ddot a little later and a little earlier, and the matrix.
    found
        The jerk, and the multipliers that bring it about.
    """

    accelerations: Sum
    saddle: Sum
    linear: Any
    motion: Array
    ahead: Array
    behind: Array
    nonzeros: Array
    found: Array


@dataclass(slots=True, kw_only=True)
class AdaptiveRun(AlphaRun):
    """A run whose steps adapt.

    Attributes
    ----------
    jerk
        By which velocities are corrected when the step changes.
    corrects
        Whether they are.
    """

    jerk: NormalJerk
    corrects: int


def normal_jerk(jerk: NormalJerk, t: float, branch: float, at: Motion, delta: float) -> int:
    """P j of a motion, of positions, see `Starter.normal_jerk`, into `jerk.found`."""
    n = at.q.size
    _accelerations(jerk, t, branch, at, delta, jerk.ahead)
    _accelerations(jerk, t, branch, at, -delta, jerk.behind)
    motion, shared = jerk.motion, jerk.saddle.shared
    combine(motion[:n], (1.0,), (at.q,))
    combine(motion[n : 2 * n], (1.0,), (at.v,))
    fill(motion[2 * n :], 0.0)
    # c_q, c_v, c_a, c_l, c_h, c_r as in MATRIX_SHARED.
    shared[0], shared[1] = t, branch
    shared[2], shared[3], shared[4] = 0.0, 0.0, 1.0
    shared[5], shared[6], shared[7] = 1.0, 1.0, 1.0
    evaluate(jerk.saddle, motion, jerk.nonzeros)
    code = factorize(jerk.linear, jerk.nonzeros)
    if code == DONE:
        fill(jerk.found[:n], 0.0)
        rate = 0.5 / delta
        combine(jerk.found[n:], (-rate, rate), (jerk.ahead, jerk.behind))
        solve(jerk.linear, jerk.found)
    return code


def _accelerations(
    jerk: NormalJerk, t: float, branch: float, at: Motion, delta: float, result: Array
) -> None:
    """g_ddot along the motion at constant acceleration."""
    n, motion, total = at.q.size, jerk.motion, jerk.accelerations
    combine(motion[:n], (1.0, delta, 0.5 * delta * delta), (at.q, at.v, at.ddq))
    combine(motion[n : 2 * n], (1.0, delta), (at.v, at.ddq))
    combine(motion[2 * n : 3 * n], (1.0,), (at.ddq,))
    fill(motion[3 * n :], 0.0)
    total.shared[0], total.shared[1] = t + delta, branch
    evaluate(total, motion, result)
