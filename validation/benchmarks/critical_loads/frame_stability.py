"""Stability functions of frames, and characteristic equations of columns, without beamdae.

Stability functions of shear-flexible, extensible members are computed from their transfer
matrices, and critical loads are counted by the inertia of the assembled stiffness (W. H. Wittrick,
F. W. Williams, Q. J. Mech. Appl. Math. 24 (1971) 263). Small motions of columns under follower and
distributed loads have Reissner's strains and section forces in the axes of the sections. Lengths
refer to L, forces to EI / L^2, masses to the mass of the column, and times to
sqrt(rho A L^4 / EI).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, root

Array = np.ndarray

# Subdivision of a member: a part buckles as a clamped column far above all loads considered.
_PARTS = 4
# Relative accuracy of the bisection.
_LOAD_TOLERANCE = 1e-11

_TOLERANCE = 1e-12
_SAMPLES = 60
# Relative distance of the frequencies whose difference gives the slope of the determinant.
_SLOPE_STEP = 1e-4


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
        if high - low <= _LOAD_TOLERANCE * high:
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


@dataclass(frozen=True)
class Column:
    """Straight column from s = 0 to 1 with its supports, loads and inertia.

    Attributes
    ----------
    start, end
        "clamped", "hinged" or, at the end, "free".
    end_load
        Compression at the end per unit load.
    distributed
        Coefficients c of the compression q(s) = sum of c_k s^k per length and unit load, directed
        to the start.
    follower_end, follower_distributed
        Fractions of the two loads that rotate with the sections.
    line_of_action
        True if the end load acts along the undeformed axis (Reut).
    cable
        Distance below the end of a fixed point to which the end load is directed; infinity for a
        fixed direction.
    foundation
        Lateral stiffness per length [EI / L^4].
    end_mass
        Mass at the end.
    damping
        Retardation time of Kelvin and Voigt.
    bending
        Bending, axial and shear stiffness at s relative to s = 0: a function of s, or None.
    """

    start: str = "clamped"
    end: str = "free"
    end_load: float = 1.0
    distributed: tuple[float, ...] = ()
    follower_end: float = 0.0
    follower_distributed: float = 0.0
    line_of_action: bool = False
    cable: float = np.inf
    foundation: float = 0.0
    end_mass: float = 0.0
    damping: float = 0.0
    bending: Callable[[float], tuple[float, float, float]] | None = None

    def compression(self, s: float) -> float:
        """Return the axial compression at s per unit load."""
        carried = sum(c * (1.0 - s ** (k + 1)) / (k + 1) for k, c in enumerate(self.distributed))
        return self.end_load + carried

    def determinant(self, beam: BeamStiffness, load: float, rate: complex) -> complex:
        """Return the characteristic determinant at the growth rate `rate` [1 / unit of time]."""
        viscosity = 1.0 + self.damping * rate
        inertia, rotary = rate**2, rate**2 / beam.EA

        def rates(s: float) -> Array:
            """A of z' = A z, z = (w, theta, Q, M)."""
            EI, EA, GA = self.bending(s) if self.bending else (1.0, 1.0, 1.0)
            P = load * self.compression(s)
            dead = load * sum(c * s**k for k, c in enumerate(self.distributed))
            dead *= 1.0 - self.follower_distributed
            stretch, shear = 1.0 - P / (EA * beam.EA), 1.0 / (GA * beam.GA * viscosity)
            return np.array(
                [
                    [0.0, stretch, shear, 0.0],
                    [0.0, 0.0, 0.0, 1.0 / (EI * viscosity)],
                    [inertia + self.foundation, -dead, 0.0, P / (EI * viscosity)],
                    [0.0, rotary, -stretch - P * shear, 0.0],
                ]
            )

        first = np.zeros((4, 2))
        first[[2, 3] if self.start == "clamped" else [1, 2], [0, 1]] = 1.0
        if self.bending or self.distributed:
            w, theta, Q, M = _integrate(rates, first)
        else:
            w, theta, Q, M = expm(rates(0.0)) @ first
        P = load * self.end_load
        lateral = Q - (1.0 - self.follower_end) * P * theta
        lateral = lateral + self.end_mass * inertia * w
        # The end descends by P / EA before it buckles.
        lateral = lateral + P / (self.cable - P / beam.EA) * w
        turning = M + P * w if self.line_of_action else M
        conditions = {
            "free": (lateral, turning),
            "hinged": (w, turning),
            "clamped": (w, theta),
        }[self.end]
        return complex(np.linalg.det(np.array(conditions)))


def _integrate(rates: Callable[[float], Array], first: Array) -> Array:
    """Return z(1) from z(0) = `first` for z' = A(s) z."""
    shape = first.shape

    def slope(s: float, z: Array) -> Array:
        return np.ravel(rates(s) @ z.reshape(shape))

    dtype = rates(0.0).dtype
    z = np.ravel(first).astype(dtype)
    end = solve_ivp(slope, (0.0, 1.0), z, "DOP853", rtol=_TOLERANCE, atol=_TOLERANCE)
    return end.y[:, -1].reshape(shape)


def divergence_loads(column: Column, beam: BeamStiffness, end: float) -> list:
    """Return the loads up to `end` at which the column has another equilibrium.

    `_SAMPLES` evaluations of the determinant must separate the loads.
    """

    def value(load: float) -> float:
        return column.determinant(beam, load, 0.0).real

    loads = np.linspace(0.0, end, _SAMPLES)
    values = [value(load) for load in loads]
    return [
        float(brentq(value, loads[k], loads[k + 1], xtol=1e-12 * end, rtol=1e-14))
        for k in range(_SAMPLES - 1)
        if values[k] * values[k + 1] < 0.0
    ]


def flutter_load(
    column: Column, beam: BeamStiffness, near: tuple[float, float]
) -> tuple[float, float]:
    """Return load and angular frequency at the onset of flutter, sought near given values.

    Without damping, two frequencies coincide; with damping, the growth rate of one vanishes.
    """
    scale = np.array(near)

    def value(load: float, frequency: float) -> complex:
        return column.determinant(beam, load, 1j * frequency)

    unit = abs(value(near[0], 0.5 * near[1]))

    def coincidence(z: Array) -> list[float]:
        load, frequency = z * scale
        step = _SLOPE_STEP * frequency
        before, at, after = (
            value(load, frequency + k * step).real / unit for k in (-1.0, 0.0, 1.0)
        )
        return [at, (after - before) / (2.0 * _SLOPE_STEP)]

    def vanishing_growth(z: Array) -> list[float]:
        number = value(*(z * scale)) / unit
        return [number.real, number.imag]

    equations = vanishing_growth if column.damping else coincidence
    solution = root(equations, np.ones(2), tol=1e-13)
    if np.max(np.abs(equations(solution.x))) > 1e-8:
        raise ArithmeticError(f"no onset of flutter near {near}: {solution.message}")
    load, frequency = solution.x * scale
    return float(load), float(frequency)
