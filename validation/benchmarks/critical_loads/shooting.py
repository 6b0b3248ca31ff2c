"""Limit and branch points of chains of beams by shooting, without beamdae.

Reissner's equations of plane beams (J. Appl. Math. Phys. 23 (1972) 795) are integrated along the
chain from one support to the other; an equilibrium is critical where the Jacobian of the boundary
conditions is singular. Lengths refer to L, forces to EI / L^2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from benchmarks.critical_loads.frame_stability import BeamStiffness
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq, root

Array = np.ndarray

_TOLERANCE = 1e-11
_COMPLEX_STEP = 1e-30
_MAX_STEP, _MAX_POINTS = 1.0, 400  # of a path; steps in EI / L^2
# Accuracy of the search along a step of the path, before the critical state is refined.
_SEARCH = 1e-4
LIMIT, BRANCH = "limit point", "branch point"


@dataclass(frozen=True)
class Segment:
    """Part of a chain with constant properties.

    Attributes
    ----------
    length
        Undeformed length.
    curvature
        Curvature of the undeformed axis: a number, or a function of arc length.
    turn
        Change of the tangent angle at a rigid corner before the segment [rad].
    load
        Point load (x, y) per unit load at the start of the segment.
    couple
        Moment per unit load at the start of the segment.
    pressure
        Force per length and unit load to the left of the section, which follows it.
    dead
        Function of arc length that returns a dead load (x, y) per length and unit load, or None.
    """

    length: float
    curvature: float | Callable[[float], float] = 0.0
    turn: float = 0.0
    load: tuple[float, float] = (0.0, 0.0)
    couple: float = 0.0
    pressure: float = 0.0
    dead: Callable[[float], tuple[float, float]] | None = None


@dataclass(frozen=True)
class Chain:
    """Segments in order from a support at the origin to another support.

    Attributes
    ----------
    angle
        Tangent angle at the start [rad].
    start, end
        "clamped" or "hinged".
    """

    segments: tuple[Segment, ...]
    angle: float
    start: str
    end: str

    def undeformed_end(self) -> tuple[float, float, float]:
        """Return position and tangent angle of the undeformed end."""
        rigid = BeamStiffness(1e300, 1e300)
        x, y, angle = self.integrate(rigid, np.zeros(3), 0.0, bending=0.0)[:3].real
        return float(x), float(y), float(angle)

    @property
    def loaded(self) -> int:
        """Number of the first segment with a load at its start; otherwise of the last one."""
        numbers = (k for k, one in enumerate(self.segments) if any(one.load))
        return next(numbers, len(self.segments) - 1)

    def position(
        self, number: int, beam: BeamStiffness | None = None, z: Array | None = None
    ) -> tuple[float, float]:
        """Return x, y of the start of a segment, undeformed or at z = (unknowns, load)."""
        part = Chain(self.segments[:number], self.angle, self.start, self.end)
        if beam is None or z is None:
            return part.undeformed_end()[:2]
        x, y = part.integrate(beam, z[:3], z[3])[:2].real
        return float(x), float(y)

    def integrate(
        self, beam: BeamStiffness, unknowns: Array, load: Any, bending: float = 1.0
    ) -> Array:
        """Return (x, y, angle, Fx, Fy, M) at the end, one column per column of `unknowns`.

        `unknowns`, (3, k), are Fx and Fy at the start, and its moment if clamped or its rotation if
        hinged; `load` has k entries. `bending` scales the bending compliance.
        """
        fx, fy, last = unknowns
        zero, clamped = 0.0 * fx, self.start == "clamped"
        angle = self.angle + (zero if clamped else last)
        state = np.array([zero, zero, angle, fx, fy, last if clamped else zero], dtype=complex)
        for segment in self.segments:
            state[2] += segment.turn
            state[3] -= load * segment.load[0]
            state[4] -= load * segment.load[1]
            state[5] -= load * segment.couple
            state = _integrate_segment(segment, beam, state, load, bending)
        return state


def _integrate_segment(
    segment: Segment, beam: BeamStiffness, state: Array, load: complex, bending: float
) -> Array:
    EA, GA = beam.EA, beam.GA
    curvature = segment.curvature if callable(segment.curvature) else None
    constant = 0.0 if curvature else float(segment.curvature)  # type: ignore[arg-type]

    shape = state.shape

    def slope(s: float, z: Array) -> Array:
        z = z.reshape(shape)
        c, d = np.cos(z[2]), np.sin(z[2])
        fx, fy = z[3], z[4]
        stretch, shear = 1.0 + (c * fx + d * fy) / EA, (c * fy - d * fx) / GA
        along, up = stretch * c - shear * d, stretch * d + shear * c
        px, py = -segment.pressure * load * d, segment.pressure * load * c
        if segment.dead is not None:
            dead = segment.dead(s)
            px, py = px + load * dead[0], py + load * dead[1]
        turn = (curvature(s) if curvature else constant) + bending * z[5]
        zero = 0.0 * z[0]
        rates = [along, up, turn + zero, zero - px, zero - py, up * fx - along * fy]
        return np.ravel(rates)

    span, accuracy = (0.0, segment.length), {"rtol": _TOLERANCE, "atol": _TOLERANCE}
    end = solve_ivp(slope, span, np.ravel(state), "DOP853", **accuracy)
    return np.asarray(end.y[:, -1]).reshape(shape)


class CriticalState(NamedTuple):
    """Critical equilibrium: kind, load, and unknowns of the shooting method."""

    kind: str
    load: float
    unknowns: Array


class Shooting:
    """Equilibria of a chain with a given section."""

    def __init__(self, chain: Chain, beam: BeamStiffness) -> None:
        self.chain, self.beam = chain, beam
        self.target = np.array([*chain.undeformed_end()])

    def evaluate(self, z: Array) -> tuple[Array, Array]:
        """Return the residual (3,) at z = (unknowns, load), and its Jacobian (3, 4)."""
        shifted = z[:, None] + 1j * _COMPLEX_STEP * np.eye(4)
        x, y, angle, _, _, moment = self.chain.integrate(self.beam, shifted[:3], shifted[3])
        last = angle - self.target[2] if self.chain.end == "clamped" else moment
        residual = np.array([x - self.target[0], y - self.target[1], last])
        return residual[:, 0].real, residual.imag / _COMPLEX_STEP

    def correct(self, z: Array, direction: Array) -> tuple[Array, Array]:
        """Return the equilibrium near z in the plane normal to `direction`, and its Jacobian."""
        begin = z
        for _ in range(12):
            residual, jacobian = self.evaluate(z)
            matrix = np.vstack([jacobian, direction])
            step = np.linalg.solve(matrix, np.append(-residual, direction @ (begin - z)))
            z = z + step
            if np.max(np.abs(step)) < 1e-10 * (1.0 + np.max(np.abs(z))):
                return z, self.evaluate(z)[1]
        raise ArithmeticError("shooting does not converge")

    def trace(self, stop: Callable[[Array], bool]) -> list[CriticalState]:
        """Return the critical states on the path from zero load until `stop(z)` is true."""
        z = np.zeros(4)
        jacobian = self.evaluate(z)[1]
        direction = _tangent(jacobian, np.array([0.0, 0.0, 0.0, 1.0]))
        determinant = np.linalg.det(jacobian[:, :3])
        states: list[CriticalState] = []
        size = _MAX_STEP
        for _ in range(_MAX_POINTS):
            while True:
                try:
                    after, jacobian = self.correct(z + size * direction, direction)
                    turned = _tangent(jacobian, direction)
                    if turned @ direction > 0.9 and np.linalg.norm(after - z) < 1.5 * size:
                        break
                except (ArithmeticError, np.linalg.LinAlgError):
                    pass
                size *= 0.5
                if size < 1e-6 * _MAX_STEP:
                    raise ArithmeticError("shooting: the path cannot be continued")
            following = np.linalg.det(jacobian[:, :3])
            if following * determinant < 0.0:
                kind = LIMIT if direction[3] * turned[3] < 0.0 else BRANCH

                near = _find_singular(self, z, direction, after, turned)
                states.append(self.refine(kind, near))
            z, direction, determinant = after, turned, following
            size = min(1.4 * size, _MAX_STEP)
            if stop(z):
                return states
        raise ArithmeticError(f"shooting: no end of the path after {_MAX_POINTS} points")

    def refine(self, kind: str, near: Array) -> CriticalState:
        """Return the critical state near `near`.

        The singular vector n is an unknown: J n = 0 at limit points, where J is the Jacobian to the
        unknowns; at branch points, the vector is sought in the transposed Jacobian, and the
        residual is relaxed along it (B. Werner, A. Spence, SIAM J. Numer. Anal. 21 (1984) 388).
        """
        jacobian = self.evaluate(near)[1]
        # Loads of shallow arches are small compared with the axial force.
        scale = np.append(np.maximum(np.abs(near[:3]), 1.0), near[3])
        unit = np.max(np.abs(jacobian[:, :3]))
        left, _, right = np.linalg.svd(jacobian[:, :3] / unit)
        vector = right[2] if kind == LIMIT else left[:, 2]

        def equations(w: Array) -> Array:
            z, n = w[:4] * scale, w[4:7]
            residual, jacobian = self.evaluate(z)
            square = jacobian[:, :3] / unit
            if kind == LIMIT:
                return np.concatenate([residual, square @ n, [vector @ n - 1.0]])
            relaxed = residual + w[7] * vector
            across = n @ jacobian[:, 3] / unit
            return np.concatenate([relaxed, square.T @ n, [vector @ n - 1.0, across]])

        start = np.concatenate([near / scale, vector, [] if kind == LIMIT else [0.0]])
        solution = root(equations, start, tol=1e-12)
        error = float(np.max(np.abs(equations(solution.x))))
        if error > 1e-7:
            raise ArithmeticError(f"shooting: no {kind} near the load {near[3]:g} ({error:.1e})")
        return CriticalState(kind, float(solution.x[3] * scale[3]), solution.x[:3] * scale[:3])


def _find_singular(
    shooting: Shooting, begin: Array, first: Array, end: Array, last: Array
) -> Array:
    """Return the point between two equilibria where the Jacobian is singular.

    The path is interpolated from its tangents, because the bordered Jacobian is singular at branch
    points as well.
    """
    path = CubicHermiteSpline(
        (0.0, 1.0), (begin, end), np.linalg.norm(end - begin) * np.stack((first, last))
    )

    def determinant(share: float) -> float:
        return float(np.linalg.det(shooting.evaluate(path(share))[1][:, :3]))

    try:
        return np.asarray(path(brentq(determinant, 0.0, 1.0, xtol=_SEARCH)))
    except ValueError:
        # The sign changed by rounding: the critical point is at one of the ends.
        return np.asarray(path(0.5))


def _tangent(jacobian: Array, along: Array) -> Array:
    """Return the unit null vector of a Jacobian (3, 4) with a positive share of `along`."""
    tangent = np.linalg.svd(jacobian)[2][3]
    return tangent if tangent @ along > 0.0 else -tangent
