"""A mechanism linearized about rest, in equilibrium or where it is let go."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.modes.saddle_point import saddle
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.equations.starts.consistent_start import Starter
from beamdae.equations.tangents import Tangent
from beamdae.errors import BeamdaeError

Array = np.ndarray
TangentAt = Callable[[State], Tangent]

# Forces that do not balance, beside those there are, and beside what rounding leaves of stiffness.
_UNBALANCED, _ROUNDING = 1e-6, 1e-13
# Beside accelerations where forces do not balance: what elements leave of a frequency that is zero.
_STILL = 1e-6
# Of the natural sizes of coordinates: the step over which the mass matrix is differentiated.
_STEP = 1e-3


def at_rest(
    e: EquationsOfMotion, time: Array, tangent: TangentAt
) -> tuple[State, Tangent, tuple[str, ...], float]:
    """State, matrices, warnings, and squares of frequencies [1/s^2] up to which they are zero.

    At the start of `e`, with the reactions there, drivers held; `tangent` is that of `e`, or under
    a share of its loads.
    """
    starter = Starter(e)
    starter.require_inertia()
    state = _released(e, tangent, starter.at_rest(starter.state(time, e.q0, np.zeros(e.n)).q))
    found, rest = tangent(state), state._replace(a=np.zeros(e.n))
    if not _is_unbalanced(e, found, state, tangent(rest).residual[: e.n]):
        return rest, tangent(rest), (), 0.0
    found = found._replace(stiffness=_covariant(e, tangent, state, found))
    share = np.abs(state.a) / e.position_scales
    worst = int(np.argmax(share))
    sentence = (
        f"{e.q_names[worst]}: it accelerates by {state.a[worst]:.3g} where it is let go, this "
        "state is no equilibrium; frequencies are those of the second derivatives of the potential "
        "there, about='equilibrium' finds where it rests."
    )
    return state, found, (sentence,), _STILL * float(share[worst])


def _released(e: EquationsOfMotion, tangent: TangentAt, rest: State) -> State:
    """Accelerations and reactions at rest: M a + F + G^T lam = 0, J a = 0."""
    found = tangent(rest)
    solve = saddle(found.mass, found.reactions, found.held_accelerations(e))
    if solve is None:
        raise BeamdaeError("modes: something can move without inertia, give it a mass or a joint.")
    solved = solve(np.concatenate([-found.residual[: e.n], np.zeros(e.m)]))
    return rest._replace(a=solved[: e.n], lam=solved[e.n :])


def _is_unbalanced(e: EquationsOfMotion, found: Tangent, state: State, force: Array) -> bool:
    """Whether the accelerations are more than what rounding leaves of an equilibrium.

    `force` is F + G^T lam without inertia.
    """
    needed = np.abs(found.mass @ state.a)
    reactions = np.abs(found.reactions @ state.lam)
    there = max(np.max(reactions, initial=0.0), np.max(np.abs(force), initial=0.0))
    rounding = _ROUNDING * (abs(found.stiffness) @ e.position_scales)
    return bool(np.any(needed > np.maximum(_UNBALANCED * there, rounding)))


def _covariant(
    e: EquationsOfMotion, tangent: TangentAt, state: State, found: Tangent
) -> sp.csc_array:
    """The stiffness that does not depend on the coordinates, at rest but not in equilibrium.

    The derivative of F at constant a depends on the coordinates it is taken in, as long as a is not
    zero. The covariant one in the metric of the mass matrix does not:

        K - (N - N^T + dM) / 2,    N = d(M a)/dq at constant a,    dM = dM/dq[a]

    of a potential V it is the Hessian of V on the manifold of the positions joints allow.
    """
    still = tangent(state._replace(a=np.zeros(e.n)))
    by_inertia = found.stiffness - still.stiffness
    step = _STEP / float(np.max(np.abs(state.a) / e.position_scales))
    masses = [tangent(state._replace(q=state.q + k * step * state.a)).mass for k in (-2, -1, 1, 2)]
    changed = (masses[0] - 8.0 * masses[1] + 8.0 * masses[2] - masses[3]) / (12.0 * step)
    return sp.csc_array(found.stiffness - 0.5 * (by_inertia - by_inertia.T + changed))
