"""Characteristic equations of columns under follower and distributed loads, without beamdae.

Small motions about a straight compressed column with Reissner's strains, section forces in the axes
of the sections. Lengths refer to L, forces to EI / L^2, masses to the mass of the column, and times
to sqrt(rho A L^4 / EI).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, root

from benchmarks.critical_loads.frame_stability import BeamStiffness

Array = np.ndarray

_TOLERANCE = 1e-12
_SAMPLES = 60
# Relative distance of the frequencies whose difference gives the slope of the determinant.
_SLOPE_STEP = 1e-4


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
