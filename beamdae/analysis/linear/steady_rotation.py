"""The state in which a mechanism turns steadily, and the equations linearized about it.

With q = c + D(W t) (z - c) + W t e the observer who turns as well sees z, see `rotation.Turning`.
What does not change for him, z, has the velocity v = W (S (z - c) + W e) and the acceleration
a = W^2 S^2 (z - c) in the inertial frame. The equations linearized about that state, with
x = D y, x' = D (y' + W S y) and x'' = D (y'' + 2 W S y' + W^2 S^2 y), are

    M y'' + (C + 2 W M S) y' + (K + W C S + W^2 M S^2) y + H mu = 0,    J y = 0

with the matrices of the inertial frame at the state turned by nothing: gyroscopic terms, spin
softening and, through the strains of the state, centrifugal stiffening are all there.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.linear.rotation import Rotation, Turning
from beamdae.analysis.modes.saddle_point import saddle
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.equations.starts.consistent_start import Starter
from beamdae.equations.tangents import Tangent, tangent
from beamdae.errors import BeamdaeError

Array = np.ndarray

# Beside the largest force: what is left where forces turn as everything does; and the angle [rad]
# by which it is turned to see whether they do.
_TURNS, _TURNED = 1e-8, 1.0
# Newton's iteration: of a change in natural sizes, what is converged, and what is still near.
_CONVERGED, _NEAR, _ITERATIONS = 1e-11, 0.5, 30
_LEAST_STEP = 2.0**-10
# Beside W^2 M, and the largest stiffness over mass: what makes the matrix regular where nothing
# holds the angle.
_FREE, _STIFF = 1e-9, 1e-16


def steady(
    e: EquationsOfMotion, time: Array, how: Rotation, near: Array | None = None
) -> tuple[State, Tangent]:
    """The state that turns steadily, and the equations linearized about it for who turns as well.

    Parameters
    ----------
    near
        Coordinates the iteration begins with; default the drawing, from which the speed grows.

    Raises
    ------
    BeamdaeError
        If nothing turns, forces do not turn with the mechanism, or there is no such state.
    """
    turning = Turning.of(e)
    if not turning.moves:
        raise BeamdaeError("rotation: nothing in this model has a place or an angle that turns.")
    begin = Starter(e).state(time, e.q0, np.zeros(e.n)).q if near is None else near
    q, lam, reached, step = begin, np.zeros(e.m), 0.0, 1.0
    # Where they do not, there may be no state to be found.
    _require_that_forces_turn(e, time, turning, how, _moving(turning, how, how.speed, q, lam))
    while reached < 1.0:
        to = min(reached + step, 1.0)
        found = _newton(e, time, turning, how, to * how.speed, q, lam)
        if found is None:
            step *= 0.5
            if step < _LEAST_STEP:
                raise BeamdaeError(
                    f"rotation: the model has no steady state at speed {how.speed:g} rad/s about "
                    f"the center {how.center}, none was found beyond {reached * how.speed:g} rad/s."
                )
            continue
        (q, lam), reached, step = found, to, 2.0 * step
    state = _moving(turning, how, how.speed, q, lam)
    _require_that_forces_turn(e, time, turning, how, state)
    own = tangent(e, time, state)
    return state, _for_who_turns(own, turning, how.speed)


def _moving(turning: Turning, how: Rotation, speed: float, q: Array, lam: Array) -> State:
    arm, s = q - turning.center(how.center), turning.generator
    return State(q, speed * (s @ arm + turning.spin), speed**2 * (s @ (s @ arm)), lam)


def _for_who_turns(own: Tangent, turning: Turning, speed: float) -> Tangent:
    s = turning.generator
    return own._replace(
        damping=sp.csc_array(own.damping + 2.0 * speed * (own.mass @ s)),
        stiffness=sp.csc_array(
            own.stiffness + speed * (own.damping @ s) + speed**2 * (own.mass @ (s @ s))
        ),
        held=sp.csc_array(own.held + speed * (own.held_rates @ s)),
    )


def _newton(
    e: EquationsOfMotion,
    time: Array,
    turning: Turning,
    how: Rotation,
    speed: float,
    q: Array,
    lam: Array,
) -> tuple[Array, Array] | None:
    last = np.inf
    for _ in range(_ITERATIONS):
        state = _moving(turning, how, speed, q, lam)
        own = tangent(e, time, state)
        seen = _for_who_turns(own, turning, speed)
        inertia = own.mass.diagonal()
        has = inertia > 0.0
        fastest = np.max(np.abs(own.stiffness.diagonal()[has]) / inertia[has], initial=0.0)
        free = _FREE * speed**2 + _STIFF * fastest
        block = seen.stiffness + (free or 1.0) * own.mass
        solve = saddle(block, seen.reactions, seen.held + seen.held_rates)
        if solve is None or not np.all(np.isfinite(own.residual)):
            return None
        change = -solve(own.residual)
        far = float(np.max(np.abs(change[: e.n]) / e.position_scales))
        if not far <= _NEAR:
            return None
        q, lam = q + change[: e.n], lam + change[e.n :]
        # Rounding of stiff beams may leave more than what counts as converged.
        if far <= _CONVERGED or (far <= 1e3 * _CONVERGED and far >= 0.5 * last):
            return q, lam
        last = far
    return None


def _require_that_forces_turn(
    e: EquationsOfMotion, time: Array, turning: Turning, how: Rotation, state: State
) -> None:
    """Refuse forces that are not the same for who turns: weight, springs to the ground."""
    d, c = turning.operator(_TURNED), turning.center(how.center)
    q = c + d @ (state.q - c) + _TURNED * turning.spin
    turned = State(q, d @ state.v, d @ state.a, np.zeros(e.m))
    own = tangent(e, time, state._replace(lam=np.zeros(e.m)))
    here = own.residual[: e.n]
    there = tangent(e, time, turned).residual[: e.n]
    off = np.abs(there - d @ here)
    inertia = np.abs(own.mass @ state.a)
    rounding = 1e-13 * (abs(own.stiffness) @ e.position_scales)
    size = max(float(np.max(np.abs(here))), float(np.max(inertia)))
    wrong = off > np.maximum(_TURNS * size, rounding)
    if np.any(wrong):
        worst = int(np.argmax(np.where(wrong, off, 0.0)))
        raise BeamdaeError(
            f"{e.q_names[worst]}: the forces on it do not turn with the mechanism, as weight and "
            "springs to the ground beside the center do not; without them there is a steady "
            "rotation."
        )
