"""Steady rotation of a whole mechanism: state and linearized equations.

An observer who rotates with the mechanism sees the coordinates z, with
q = c + D(W t) (z - c) + W t e; W is the speed, and D, c, e and the generator S are defined in
`RotatingCoordinates`. A constant z has the velocity
v = W (S (z - c) + e) and the acceleration a = W^2 S^2 (z - c) in the inertial frame. The
equations linearized about that state, with x = D y, x' = D (y' + W S y) and
x'' = D (y'' + 2 W S y' + W^2 S^2 y), are

    M y'' + (C + 2 W M S) y' + (K + W C S + W^2 M S^2) y + H mu = 0,
    (J + W V S) y + V y' = 0

with the matrices of the inertial frame at t = 0. They contain gyroscopic terms, spin softening
and, through the strains of the state, centrifugal stiffening.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import (
    Convert,
    Tangent,
    compute_residual,
    compute_tangent,
    tangent_of,
)
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.mobility import find_free_groups
from beamdae.equations.starts.relaxation import find_nearby_equilibrium
from beamdae.equations.starts.rigid_motions import collect_bodies
from beamdae.errors import BeamdaeError, list_first
from beamdae.parts.joints.drivers import Driver
from beamdae.parts.joints.joint import Revolute
from beamdae.parts.rotation import Rotation

Array = np.ndarray

# Rounding error of elastic forces, relative to |K| times the natural sizes.
STIFFNESS_ROUNDING = 1e-13
# Forces rotate with the mechanism if they change by less than this fraction of the largest force.
_FORCE_TOLERANCE = 1e-8
# Angle by which the mechanism is rotated to compare forces [rad].
_TEST_ANGLE = 1.0
# Distance from the bearing to the center, relative to the characteristic length, up to which a
# rotor has no warning. For a blade of 0.9 m on a hub at 314 rad/s, 0.005 changes the first
# frequency by 0.6 %, and 0.5 by 50 %.
_MAX_CENTER_DISTANCE = 5e-3


@dataclass(frozen=True)
class RotatingCoordinates:
    """Transformation of coordinates under a rigid rotation: q = c + D (z - c) + angle * e.

    D rotates the pairs (x, y) about the center c, angle * e is added to inertial angles, and
    coordinates relative to a body do not change. z are the coordinates in the rotating frame.

    Attributes
    ----------
    n
        Number of coordinates.
    x, y
        Indices of the x and y coordinates of points, in pairs.
    angles
        Indices of the inertial angles.
    """

    n: int
    x: Array
    y: Array
    angles: Array

    @classmethod
    def from_equations(cls, e: EquationsOfMotion) -> RotatingCoordinates:
        """Return the coordinates of the points and angles of all bodies, see `Body`."""
        bodies = collect_bodies(e)
        x, y = np.vstack([np.zeros((0, 2), int), *(body.points for body in bodies)]).T
        return cls(e.n, x, y, np.concatenate([np.zeros(0, int), *(x.angles for x in bodies)]))

    @property
    def can_rotate(self) -> bool:
        """True if there are coordinates that change in a rotation: points or inertial angles."""
        return bool(len(self.x) or len(self.angles))

    def rotation_matrix(self, angle: float) -> sp.csr_array:
        """Return D for an angle [rad], sparse (n, n)."""
        diagonal = np.ones(self.n)
        diagonal[self.x] = diagonal[self.y] = np.cos(angle)
        return sp.csr_array(sp.diags_array(diagonal) + np.sin(angle) * self.generator)

    @property
    def generator(self) -> sp.csr_array:
        """Generator S of the rotation: dD/d(angle) at angle 0, sparse (n, n)."""
        ones = np.ones(len(self.x))
        entries = np.concatenate([ones, -ones])
        positions = (np.concatenate([self.y, self.x]), np.concatenate([self.x, self.y]))
        return sp.csr_array((entries, positions), shape=(self.n, self.n))

    def center_vector(self, center: tuple[float, float]) -> Array:
        """Return c, (n,): `center` [m] in each pair (x, y), 0 otherwise."""
        vector = np.zeros(self.n)
        vector[self.x], vector[self.y] = center
        return vector

    @property
    def angle_vector(self) -> Array:
        """Vector e, (n,): 1 for inertial angles, 0 otherwise."""
        vector = np.zeros(self.n)
        vector[self.angles] = 1.0
        return vector

    @property
    def translations(self) -> Array:
        """Changes of coordinates in unit translations along x and y, (n, 2)."""
        changes = np.zeros((self.n, 2))
        changes[self.x, 0] = changes[self.y, 1] = 1.0
        return changes


def find_steady_rotation(
    e: EquationsOfMotion,
    time: Array,
    rotation: Rotation,
    guess: Array | None = None,
    frozen_forces: bool = False,
) -> State:
    """Return the state of steady rotation.

    It is an equilibrium in the rotating frame, see `find_nearby_equilibrium`.

    Parameters
    ----------
    e
        Equations of motion with independent constraints.
    time
        (t, branch), at which laws are evaluated.
    rotation
        Speed and center of the rotation.
    guess
        Coordinates (n,) at which the iteration begins. Defaults to the start positions of `e`,
        corrected to satisfy the constraints.
    frozen_forces
        True to admit forces that do not rotate with the mechanism, such as weight; they act as at
        `time`.

    Raises
    ------
    BeamdaeError
        If no coordinate rotates, no state is found or, without `frozen_forces`, forces do not
        rotate with the mechanism.
    """
    frame = RotatingCoordinates.from_equations(e)
    if not frame.can_rotate:
        raise BeamdaeError(
            "rotation: the model has no coordinates that can rotate (x and y, angle, "
            "theta or psi); release a body from the ground."
        )
    q = ConsistencySolver(e).state(time, e.q0, np.zeros(e.n)).q if guess is None else guess
    # Checked first, because no steady state may exist if forces do not rotate.
    if not frozen_forces:
        _require_rotating_forces(e, time, frame, rotation, q)
    solution = find_nearby_equilibrium(RotatingEquations(e, time, rotation), q)
    if solution is None:
        cause, remedy = "", "check that the mechanism turns about this center, or use a lower speed"
        if free := find_free_groups(e, time, q):
            names = "; ".join(list_first(group) for group in free)
            cause, remedy = (
                f", because no joint or spring holds {names}",
                "add a joint, such as a Weld",
            )
        raise BeamdaeError(
            f"rotation: no steady state was found at {rotation.speed:g} rad/s about the center "
            f"{rotation.center} [m]{cause}; {remedy}."
        )
    q, lam = solution
    if not frozen_forces:
        _require_rotating_forces(e, time, frame, rotation, q)
    return rotating_state(e, rotation, q, lam)


@dataclass(frozen=True)
class RotatingEquations:
    """Equations of equilibrium in a rotating frame, see `StaticSystem`."""

    equations: EquationsOfMotion
    time: Array
    rotation: Rotation

    def convert(self, change: Convert) -> RotatingEquations:
        """Return these equations of converted equations of motion."""
        return replace(self, equations=change(self.equations))

    def residual(self, q: Array, lam: Array) -> Array:
        """Return F + G^T lam and the constraints of a mechanism that rotates, (n + m,)."""
        state = rotating_state(self.equations, self.rotation, q, lam)
        return compute_residual(self.equations, self.time, state)

    def matrix(self, q: Array, lam: Array) -> sp.csc_array:
        """Return the Jacobian of the residual, sparse (n + m, n + m)."""
        state = rotating_state(self.equations, self.rotation, q, lam)
        rotating = rotating_tangent(self.equations, self.time, self.rotation, state)
        # Nonholonomic constraints restrict changes of positions as they restrict velocities.
        rows = rotating.position_jacobian + rotating.velocity_jacobian
        blocks = [[rotating.stiffness, rotating.reactions], [rows, None]]
        return sp.csc_array(sp.block_array(blocks) if self.equations.m else rotating.stiffness)


def rotating_tangent(
    e: EquationsOfMotion,
    time: Array,
    rotation: Rotation,
    state: State,
    convert: Convert | None = None,
) -> Tangent:
    """Return the matrices of converted equations in the rotating frame, see the module."""
    tangent, speed = tangent_of(e, time, state, convert), rotation.speed
    s = RotatingCoordinates.from_equations(e).generator
    return tangent._replace(
        damping=sp.csc_array(tangent.damping + 2.0 * speed * (tangent.mass @ s)),
        stiffness=sp.csc_array(
            tangent.stiffness + speed * (tangent.damping @ s) + speed**2 * (tangent.mass @ (s @ s))
        ),
        position_jacobian=sp.csc_array(
            tangent.position_jacobian + speed * (tangent.velocity_jacobian @ s)
        ),
    )


def center_warning(e: EquationsOfMotion, rotation: Rotation) -> str:
    """Return a warning if a driven rotor has its bearing away from the center, or "".

    The only joints between the ground and the rotor are hinges at one point, and drivers. Other
    mechanisms are mounted on a turntable: those with other joints or several bearings, and without
    a driver, such as a blade on an offset lag hinge.
    """
    mechanism = e.mechanism
    if mechanism is None or rotation.speed == 0.0:
        return ""
    bearings: dict[str, tuple[float, float]] = {}
    is_driven = False
    for part in mechanism.parts.values():
        grounded = [x for x in part.attachments if x.body is mechanism.ground]
        if not grounded or part.name in mechanism.inactive:
            continue
        if isinstance(part, Revolute):
            bearings[part.name] = grounded[0].point
        elif isinstance(part, Driver):
            is_driven = True
        elif part.constraints():
            return ""
    if not (bearings and is_driven):
        return ""
    points, limit = np.array(list(bearings.values())), _MAX_CENTER_DISTANCE * e.length
    spread = np.hypot(*(points - points[0]).T)
    distance = np.hypot(*(points[0] - rotation.center))
    if np.any(spread > limit) or distance <= limit:
        return ""
    name = next(iter(bearings))
    center, place = ("({:.6g}, {:.6g})".format(*x) for x in (rotation.center, points[0]))
    return (
        f"rotation: the center {center} is not at {name}, which is at {place}; pass "
        f"center={place}, or draw the rotor about the center."
    )


def rotating_state(e: EquationsOfMotion, rotation: Rotation, q: Array, lam: Array) -> State:
    """Return the state at positions q that rotates rigidly with the whole mechanism."""
    frame, speed = RotatingCoordinates.from_equations(e), rotation.speed
    arm, s = q - frame.center_vector(rotation.center), frame.generator
    return State(q, speed * (s @ arm + frame.angle_vector), speed**2 * (s @ (s @ arm)), lam)


def _require_rotating_forces(
    e: EquationsOfMotion,
    time: Array,
    frame: RotatingCoordinates,
    rotation: Rotation,
    q: Array,
) -> None:
    state = rotating_state(e, rotation, q, np.zeros(e.m))
    d, c = frame.rotation_matrix(_TEST_ANGLE), frame.center_vector(rotation.center)
    turned = c + d @ (q - c) + _TEST_ANGLE * frame.angle_vector
    rotated = State(turned, d @ state.v, d @ state.a, np.zeros(e.m))
    tangent = compute_tangent(e, time, state)
    forces = tangent.residual[: e.n]
    rotated_forces = compute_tangent(e, time, rotated).residual[: e.n]
    difference = np.abs(rotated_forces - d @ forces)
    inertia = np.abs(tangent.mass @ state.a)
    rounding = STIFFNESS_ROUNDING * (abs(tangent.stiffness) @ e.position_scales)
    size = max(float(np.max(np.abs(forces))), float(np.max(inertia)))
    is_different = difference > np.maximum(_FORCE_TOLERANCE * size, rounding)
    if np.any(is_different):
        worst = int(np.argmax(np.where(is_different, difference, 0.0)))
        raise BeamdaeError(
            f"{e.q_names[worst]}: the forces on this coordinate do not rotate with the "
            "mechanism; remove such forces: weight, loads of fixed direction, and springs "
            "and dampers attached to the ground away from the center."
        )
