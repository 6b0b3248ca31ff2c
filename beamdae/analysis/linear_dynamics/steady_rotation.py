"""The state in which a mechanism turns steadily, and the equations linearized about it.

With q = c + D(W t) (z - c) + W t e the observer who turns as well sees z, see `rotation.RotatingCoordinates`.
What does not change for him, z, has the velocity v = W (S (z - c) + W e) and the acceleration
a = W^2 S^2 (z - c) in the inertial frame. The equations linearized about that state, with
x = D y, x' = D (y' + W S y) and x'' = D (y'' + 2 W S y' + W^2 S^2 y), are

    M y'' + (C + 2 W M S) y' + (K + W C S + W^2 M S^2) y + H mu = 0,    J y = 0

with the matrices of the inertial frame at the state turned by nothing: gyroscopic terms, spin
softening and, through the strains of the state, centrifugal stiffening are all there.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import Tangent, compute_tangent
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.errors import BeamdaeError, require_finite, require_point
from beamdae.linear.saddle_point import factorize_saddle_point

Array = np.ndarray

_PLACES, _ANGLES = re.compile(r"([xy])(\d*)"), re.compile(r"(?:angle|theta|psi)\d*")


@dataclass(frozen=True)
class Rotation:
    """A steady rotation at `speed` [rad/s] about the point `center` [m]; see `rotation`."""

    speed: float
    center: tuple[float, float] = (0.0, 0.0)


def rotation(speed: float, center: tuple[float, float] = (0.0, 0.0)) -> Rotation:
    """State of `modes` and `linearize`: all of a mechanism turns about a point at one speed.

    The ground is a turntable: what joints tie to it turns with it, and drivers hold what they hold
    at t = 0 relative to it. Coordinates are those an observer sees who turns as well, so that
    frequencies are what a strain gauge on the mechanism measures. Forces must turn with it: weight,
    loads of fixed direction, and springs and dampers to the ground off the center are refused.

    Parameters
    ----------
    speed
        Angular speed [rad/s], counter-clockwise positive.
    center
        The point of the drawing it turns about [m].

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.rotation(6.0)
    Rotation(speed=6.0, center=(0.0, 0.0))
    """
    return Rotation(
        require_finite("rotation", "speed", speed), require_point("rotation", "center", center)
    )


@dataclass(frozen=True)
class RotatingCoordinates:
    """How coordinates follow when everything turns: q = c + D (z - c) + angle * e.

    D turns the pairs (x, y), the angles grow by the angle, and what is measured within a body
    stays; z are the coordinates seen by an observer who turns as well.

    Attributes
    ----------
    n
        Number of coordinates.
    x, y
        Which coordinates are places, a pair each.
    angles
        Which are angles in the inertial frame.
    """

    n: int
    x: Array
    y: Array
    angles: Array

    @classmethod
    def of(cls, e: EquationsOfMotion) -> RotatingCoordinates:
        """By the names of coordinates: x and y, angle, theta or psi, perhaps numbered."""
        x, y, angles = [], [], []
        index = {name: k for k, name in enumerate(e.q_names)}
        for name, k in index.items():
            part, dot, own = name.rpartition(".")
            place = _PLACES.fullmatch(own)
            if place and place[1] == "x" and f"{part}{dot}y{place[2]}" in index:
                x.append(k)
                y.append(index[f"{part}{dot}y{place[2]}"])
            elif _ANGLES.fullmatch(own) and e.coordinates[k].unit == "rad":
                angles.append(k)
        return cls(e.n, *(np.array(found, int) for found in (x, y, angles)))

    @property
    def moves(self) -> bool:
        """Whether anything turns at all."""
        return bool(len(self.x) or len(self.angles))

    def operator(self, angle: float) -> sp.csr_array:
        """D, (n, n)."""
        kept = np.ones(self.n)
        kept[self.x] = kept[self.y] = np.cos(angle)
        return sp.csr_array(sp.diags_array(kept) + np.sin(angle) * self.generator)

    @property
    def generator(self) -> sp.csr_array:
        """S = dD/d(angle) at 0, which D is the exponential of on the places."""
        ones = np.ones(len(self.x))
        entries = np.concatenate([ones, -ones])
        at = (np.concatenate([self.y, self.x]), np.concatenate([self.x, self.y]))
        return sp.csr_array((entries, at), shape=(self.n, self.n))

    def center(self, place: tuple[float, float]) -> Array:
        """c, (n,): the place in all pairs."""
        found = np.zeros(self.n)
        found[self.x], found[self.y] = place
        return found

    @property
    def spin(self) -> Array:
        """e, (n,): one for each angle."""
        found = np.zeros(self.n)
        found[self.angles] = 1.0
        return found

    def travel(self, axis: int) -> Array:
        """Rate of all coordinates when everything travels along x (0) or y (1), (n,)."""
        found = np.zeros(self.n)
        found[(self.x, self.y)[axis]] = 1.0
        return found


# Beside the largest force: what is left where forces turn as everything does; and the angle [rad]
# by which it is turned to see whether they do.
_TURNS, _TURNED = 1e-8, 1.0
# Newton's iteration: of a change in natural sizes, what is converged, and what is still near.
_CONVERGED, _NEAR, _ITERATIONS = 1e-11, 0.5, 30
_LEAST_STEP = 2.0**-10
# Beside W^2 M, and the largest stiffness over mass: what makes the matrix regular where nothing
# holds the angle.
_FREE, _STIFF = 1e-9, 1e-16


def find_steady_rotation(
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
    turning = RotatingCoordinates.of(e)
    if not turning.moves:
        raise BeamdaeError("rotation: nothing in this model has a place or an angle that turns.")
    begin = ConsistencySolver(e).state(time, e.q0, np.zeros(e.n)).q if near is None else near
    q, lam, reached, step = begin, np.zeros(e.m), 0.0, 1.0
    # Where they do not, there may be no state to be found.
    _require_rotating_forces(
        e, time, turning, how, _rotating_state(turning, how, how.speed, q, lam)
    )
    while reached < 1.0:
        to = min(reached + step, 1.0)
        found = _solve_steady_state(e, time, turning, how, to * how.speed, q, lam)
        if found is None:
            step *= 0.5
            if step < _LEAST_STEP:
                raise BeamdaeError(
                    f"rotation: the model has no steady state at speed {how.speed:g} rad/s about "
                    f"the center {how.center}, none was found beyond {reached * how.speed:g} rad/s."
                )
            continue
        (q, lam), reached, step = found, to, 2.0 * step
    state = _rotating_state(turning, how, how.speed, q, lam)
    _require_rotating_forces(e, time, turning, how, state)
    own = compute_tangent(e, time, state)
    return state, _to_rotating_frame(own, turning, how.speed)


def _rotating_state(
    turning: RotatingCoordinates, how: Rotation, speed: float, q: Array, lam: Array
) -> State:
    arm, s = q - turning.center(how.center), turning.generator
    return State(q, speed * (s @ arm + turning.spin), speed**2 * (s @ (s @ arm)), lam)


def _to_rotating_frame(own: Tangent, turning: RotatingCoordinates, speed: float) -> Tangent:
    s = turning.generator
    return own._replace(
        damping=sp.csc_array(own.damping + 2.0 * speed * (own.mass @ s)),
        stiffness=sp.csc_array(
            own.stiffness + speed * (own.damping @ s) + speed**2 * (own.mass @ (s @ s))
        ),
        position_jacobian=sp.csc_array(own.position_jacobian + speed * (own.velocity_jacobian @ s)),
    )


def _solve_steady_state(
    e: EquationsOfMotion,
    time: Array,
    turning: RotatingCoordinates,
    how: Rotation,
    speed: float,
    q: Array,
    lam: Array,
) -> tuple[Array, Array] | None:
    last = np.inf
    for _ in range(_ITERATIONS):
        state = _rotating_state(turning, how, speed, q, lam)
        own = compute_tangent(e, time, state)
        seen = _to_rotating_frame(own, turning, speed)
        inertia = own.mass.diagonal()
        has = inertia > 0.0
        fastest = np.max(np.abs(own.stiffness.diagonal()[has]) / inertia[has], initial=0.0)
        free = _FREE * speed**2 + _STIFF * fastest
        block = seen.stiffness + (free or 1.0) * own.mass
        solve = factorize_saddle_point(
            block, seen.reactions, seen.position_jacobian + seen.velocity_jacobian
        )
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


def _require_rotating_forces(
    e: EquationsOfMotion, time: Array, turning: RotatingCoordinates, how: Rotation, state: State
) -> None:
    """Refuse forces that are not the same for who turns: weight, springs to the ground."""
    d, c = turning.operator(_TURNED), turning.center(how.center)
    q = c + d @ (state.q - c) + _TURNED * turning.spin
    turned = State(q, d @ state.v, d @ state.a, np.zeros(e.m))
    own = compute_tangent(e, time, state._replace(lam=np.zeros(e.m)))
    here = own.residual[: e.n]
    there = compute_tangent(e, time, turned).residual[: e.n]
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
