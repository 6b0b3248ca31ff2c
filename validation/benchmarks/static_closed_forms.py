"""Closed-form equilibria of a cantilever, a quarter circle and a ring."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

import beamdae as bd


def elastica(load: float) -> tuple[float, float, float, float]:
    """Return u / L, w / L, the slope of the tip [rad] and M L / EI at the clamp.

    The cantilever is inextensible, under a transverse dead force P: `load` = P L^2 / EI =
    (K(k) - F(d, k))^2 with the amplitude d = asin(1 / (k sqrt(2))).
    """

    def residual(k: float) -> float:
        return (ellipk(k**2) - ellipkinc(_amplitude(k), k**2)) ** 2 - load

    k = brentq(residual, np.sqrt(0.5) + 1e-12, 1.0 - 1e-12, xtol=1e-15)
    slope = 2.0 * (0.25 * np.pi - np.arccos(k))
    lever = np.sqrt(2.0 * np.sin(slope) / load)
    arc = ellipe(k**2) - ellipeinc(_amplitude(k), k**2)
    return 1.0 - lever, 1.0 - 2.0 * arc / np.sqrt(load), slope, load * lever


def _amplitude(k: float) -> float:
    return float(np.arcsin(np.sqrt(0.5) / k))


def quarter_circle(radius: float, section: bd.Section) -> dict[str, float]:
    """Return tip displacements of a clamped quarter circle under unit tip loads (Castigliano)."""
    R, EI, EA, GA = radius, section.EI, section.EA, section.GA
    stretch = np.pi * R / 4.0 * (1.0 / EA + 1.0 / GA)
    across = -(R**3) / (2.0 * EI) + R / 2.0 * (1.0 / EA - 1.0 / GA)
    along = R**2 / EI * (0.5 * np.pi - 1.0)
    return {
        "radial by radial": np.pi * R**3 / (4.0 * EI) + stretch,
        "tangential by radial": across,
        "turn by radial": -(R**2) / EI,
        "radial by tangential": across,
        "tangential by tangential": R**3 / EI * (0.75 * np.pi - 2.0) + stretch,
        "turn by tangential": along,
        "radial by moment": -(R**2) / EI,
        "tangential by moment": along,
        "turn by moment": np.pi * R / (2.0 * EI),
    }


def pinched_ring(radius: float, section: bd.Section) -> dict[str, float]:
    """Return the approach of the loaded points of a pinched ring and its transverse growth."""
    R, EI, EA, GA = radius, section.EI, section.EA, section.GA
    approach = R**3 / EI * (0.25 * np.pi - 2.0 / np.pi) + 0.25 * np.pi * R * (1.0 / EA + 1.0 / GA)
    growth = R**3 / EI * (2.0 / np.pi - 0.5) - 0.5 * R / EA + 0.5 * R / GA
    return {"approach": approach, "growth": growth}
