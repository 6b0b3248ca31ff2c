"""Where a run got stuck, in parts: what is not finite, what is torn, what changes fastest."""

from __future__ import annotations

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.starts.rank import build_constraint_jacobian
from beamdae.equations.starts.state_evaluator import StateEvaluator

Array = np.ndarray

# Joints this near to losing rank are likely to be the cause; of rows of length one.
_NEAR = 5e-2
# What a residual in one of the equations is at least, beside those that balance in it.
_MATTERS = 1e-6


def diagnose_failure(
    equations: EquationsOfMotion,
    time: Array,
    state: State,
    ahead: float,
    residual: Array | None = None,
) -> str:
    """Likely causes of a run that stopped after `state` at time = (t, branch), most likely first.

    Parameters
    ----------
    ahead
        A time a little later [s], at which forces may no longer be finite.
    residual
        Of a first-order form where it was given up: rows of velocities, forces and constraints.

    Returns
    -------
    str
        "cause; cause; what to do", or "" where nothing stands out.
    """
    with np.errstate(all="ignore"):
        not_finite = _describe_non_finite(equations, np.array([ahead, time[1]]), state)
        if not_finite:
            return not_finite
        causes = [
            _describe_rank_loss(equations, time, state),
            _describe_largest_residual(equations, state, residual),
            _describe_fastest_coordinate(equations, state),
        ]
    return "; ".join(filter(None, causes))


def _describe_non_finite(e: EquationsOfMotion, time: Array, state: State) -> str:
    own = StateEvaluator(e)
    bad = np.flatnonzero(~np.isfinite(own.force(time, state.q, state.v)))
    if len(bad):
        return f"the force on {e.q_names[bad[0]]} is not finite from there on, look at its law"
    bad = np.flatnonzero(~np.isfinite(own.constraint_levels(time, state.q, state.v)).all(axis=0))
    return f"{e.lam_names[bad[0]]} is not finite from there on, look at its law" if len(bad) else ""


def _describe_rank_loss(e: EquationsOfMotion, time: Array, state: State) -> str:
    if not e.m or not np.isfinite(state.q).all():
        return ""
    joints = build_constraint_jacobian(e)
    if not joints.smallest(time[None], state.q[None])[0] < _NEAR:
        return ""
    names = ", ".join(joints.losing(time, state.q))
    return (
        f"the joints {names} are near a position in which they lock or lose rank, look whether the "
        "mechanism can go past it"
    )


def _describe_largest_residual(e: EquationsOfMotion, state: State, residual: Array | None) -> str:
    """The equation whose residual is largest, each kind beside its natural size."""
    if residual is None or not np.isfinite(residual).all():
        return ""
    n, m = e.n, e.m
    speed = float(np.max(np.abs(state.v) / e.position_scales)) or 1.0
    force = max(float(np.max(np.abs(state.lam), initial=0.0)), 1e-300)
    sizes = np.concatenate(
        [speed * e.position_scales, np.full(n, force), np.full(len(residual) - 2 * n, e.length)]
    )
    shares = np.abs(residual) / sizes
    worst = int(np.argmax(shares))
    if not shares[worst] > _MATTERS:
        return ""
    if worst >= 2 * n:
        where = f"the constraint {e.lam_names[(worst - 2 * n) % m]}"
    else:
        what = "the balance of forces on" if worst >= n else "the rate of"
        where = f"{what} {e.q_names[worst % n]}"
    return f"the largest residual is that of {where}"


def _describe_fastest_coordinate(e: EquationsOfMotion, state: State) -> str:
    """The coordinate that accelerates most, in natural sizes."""
    rates = np.abs(state.a) / e.position_scales
    if not np.isfinite(rates).all() or not np.any(rates):
        return ""
    worst = int(np.argmax(rates))
    return (
        f"{e.q_names[worst]} accelerates most, by {state.a[worst]:.3g} "
        f"{e.coordinates[worst].unit}/s^2"
    )
