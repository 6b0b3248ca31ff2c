"""Exact critical loads of frames of straight members in pure compression, without beamdae.

Stability functions of shear-flexible, extensible members are computed from their transfer
matrices, and critical loads are counted by the inertia of the assembled stiffness (W. H. Wittrick,
F. W. Williams, Q. J. Mech. Appl. Math. 24 (1971) 263). Lengths refer to L, forces to EI / L^2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

Array = np.ndarray

# Subdivision of a member: a part buckles as a clamped column far above all loads considered.
_PARTS = 4
# Relative accuracy of the bisection.
_TOLERANCE = 1e-11


@dataclass(frozen=True)
class Member:
    """Straight member between two nodes.

    Attributes
    ----------
    compression
        Axial compression per unit load [-].
    width
        Width relative to the reference section; scales all stiffnesses.
    hinges
        "a", "b" or both, for hinged connections to the nodes.
    """

    a: str
    b: str
    compression: float = 0.0
    width: float = 1.0
    hinges: str = ""


@dataclass(frozen=True)
class FrameDescription:
    """Frame whose members carry axial forces only until it buckles.

    Attributes
    ----------
    nodes
        Positions over L.
    supports
        Fixed displacements of nodes: letters of "xyr".
    springs
        Stiffness of springs to the ground in x, y [EI / L^3] and rotation [EI / L].
    loads
        Forces (x, y) per unit load [-].
    """

    nodes: Mapping[str, tuple[float, float]]
    members: tuple[Member, ...]
    supports: Mapping[str, str]
    loads: Mapping[str, tuple[float, float]]
    springs: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def length(self, member: Member) -> float:
        """Return the length of a member over L."""
        return float(np.hypot(*np.subtract(self.nodes[member.b], self.nodes[member.a])))

    def wave_angle(self, load: float) -> float:
        """Return the largest sqrt(P / EI) times length of the members [rad]."""
        return max(
            self.length(one) * np.sqrt(abs(one.compression * load) / one.width)
            for one in self.members
        )


@dataclass(frozen=True)
class BeamStiffness:
    """Stiffness of the reference section relative to its bending stiffness: EA, GA [1 / L^2].

    `strain` selects "exact" (Reissner's strains; shear as in Haringx's theory) or "green" (Green's
    axial strain and linear shear; shear as in Engesser's theory).
    """

    EA: float
    GA: float
    strain: str = "exact"

    def lateral_rates(self, P: float) -> Array:
        """Return A of z' = A z for z = (w, theta, V, M) under the compression P, with EI = 1.

        w and theta are deflection and section angle, V the transverse force in the inertial frame
        and M the moment; s is the undeformed arc length.

        Reissner: with the stretch e = 1 - P / EA and c = e + P / GA, w' = c theta + V / GA and
        M' = -c (P theta + V). Without V, buckling occurs where P (1 - P / EA + P / GA) reaches
        Euler's load. Green: e (1 - e^2) / 2 = P / EA; with S = P / e, w' = (GA theta + V) /
        (GA - S) and M' = -(V + S w').
        """
        rates = np.zeros((4, 4))
        rates[1, 3] = 1.0
        if self.strain == "exact":
            c = 1.0 - P / self.EA + P / self.GA
            rates[0, 1:3] = c, 1.0 / self.GA
            rates[3, 1:3] = -c * P, -c
        else:
            S = P / green_stretch(P / self.EA)
            rates[0, 1:3] = self.GA / (self.GA - S), 1.0 / (self.GA - S)
            rates[3] = -S * rates[0]
            rates[3, 2] -= 1.0
        return rates


def green_stretch(compression: float) -> float:
    """Return the stretch e > 1 / sqrt(3) at P / EA = `compression`: e (1 - e^2) / 2 = P / EA."""
    if compression == 0.0:
        return 1.0
    return float(brentq(lambda e: 0.5 * e * (1.0 - e * e) - compression, 3.0**-0.5, 2.0))


def lateral_stiffness(beam: BeamStiffness, P: float, length: float) -> Array:
    """Return the stiffness of a member for (w, theta) at its start and its end, with EI = 1."""
    transfer = expm(length * beam.lateral_rates(P))
    A, B, C, D = transfer[:2, :2], transfer[:2, 2:], transfer[2:, :2], transfer[2:, 2:]
    inverse = np.linalg.inv(B)
    start, end = np.hstack([-inverse @ A, inverse]), np.hstack([C, np.zeros((2, 2))])
    end = end + D @ start
    stiffness = np.vstack([-start, end])
    return 0.5 * (stiffness + stiffness.T)


def count_unstable(frame: FrameDescription, beam: BeamStiffness, load: float) -> int:
    """Return the number of critical loads below `load`.

    The axial forces are unknowns with the compliance of their members, so that slender members do
    not spoil the conditioning; each adds one negative eigenvalue to the matrix.
    """
    numbers: dict[tuple[str, str], int] = {}
    fixed = {(node, axis) for node, axes in frame.supports.items() for axis in axes}

    def number(node: str, axis: str) -> int:
        key = (node, axis)
        return -1 if key in fixed else numbers.setdefault(key, len(numbers))

    blocks: list[tuple[Array, Array, list[int]]] = []
    for k, member in enumerate(frame.members):
        span = np.subtract(frame.nodes[member.b], frame.nodes[member.a])
        length = frame.length(member)
        along = span / length
        across = np.array([-along[1], along[0]])
        P = member.compression * load / member.width
        part = lateral_stiffness(beam, P, length / _PARTS) * member.width
        for i in range(_PARTS):
            first = member.a if i == 0 else f"{k}.{i}"
            last = member.b if i == _PARTS - 1 else f"{k}.{i + 1}"
            turns = [first, last]
            if i == 0 and "a" in member.hinges:
                turns[0] = f"{k}.hinge a"
            if i == _PARTS - 1 and "b" in member.hinges:
                turns[1] = f"{k}.hinge b"
            indices = [
                number(first, "x"),
                number(first, "y"),
                number(turns[0], "r"),
                number(last, "x"),
                number(last, "y"),
                number(turns[1], "r"),
            ]
            to_local = np.zeros((4, 6))
            to_local[0, :2], to_local[1, 2], to_local[2, 3:5], to_local[3, 5] = across, 1, across, 1
            elongation = np.concatenate([-along, [0.0], along, [0.0]])
            compliance = length / _PARTS / (beam.EA * member.width)
            block = np.zeros((7, 7))
            block[:6, :6] = to_local.T @ part @ to_local
            block[6, :6] = block[:6, 6] = elongation
            block[6, 6] = -compliance
            blocks.append((block, elongation, [*indices, number(f"{k}.{i}", "N")]))
    size = len(numbers)
    matrix = np.zeros((size, size))
    for block, _, indices in blocks:
        used = [j for j, index in enumerate(indices) if index >= 0]
        rows = [indices[j] for j in used]
        matrix[np.ix_(rows, rows)] += block[np.ix_(used, used)]
    for node, stiffness in frame.springs.items():
        for axis, value in zip("xyr", stiffness, strict=True):
            index = number(node, axis)
            if value and index >= 0:
                matrix[index, index] += value
    return int(np.sum(np.linalg.eigvalsh(matrix) < 0.0)) - len(blocks)


def critical_loads(count: Callable[[float], int], end: float) -> list[float]:
    """Return the loads between 0 and `end` at which `count` increases, with their multiplicity."""
    loads: list[float] = []

    def bisect(low: float, high: float, low_count: int, high_count: int) -> None:
        if low_count == high_count:
            return
        middle = 0.5 * (low + high)
        if high - low <= _TOLERANCE * high:
            loads.extend([middle] * abs(high_count - low_count))
            return
        middle_count = count(middle)
        bisect(low, middle, low_count, middle_count)
        bisect(middle, high, middle_count, high_count)

    begin = 1e-9 * end
    bisect(begin, end, count(begin), count(end))
    return loads


def frame_critical_loads(frame: FrameDescription, beam: BeamStiffness, end: float) -> list[float]:
    """Return the critical loads [EI / L^2] of a frame up to `end`, in ascending order."""
    return critical_loads(lambda load: count_unstable(frame, beam, load), end)
