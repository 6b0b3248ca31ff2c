"""Periodic motions with answers in closed form, or by special functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import mathieu_b

import beamdae as bd

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class KnownPeriodic:
    """A mechanism, and what is known of its periodic motion.

    Attributes
    ----------
    known
        Numbers by name.
    within
        Relative error that is to be met.
    ours
        The same by shooting.
    """

    name: str
    source: str
    known: Mapping[str, float]
    within: float
    ours: Callable[[], Mapping[str, float]]

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row for each of the numbers."""
        found = self.ours()
        for quantity, known in self.known.items():
            error = abs(found[quantity] - known)
            yield {
                "case": self.name,
                "setting": "periodic",
                "quantity": quantity,
                "published": f"{known:.12g}",
                "ours": f"{found[quantity]:.12g}",
                "error": f"{error:.2e}",
                "relative": f"{error / abs(known):.2e}",
                "ended": "",
            }


# A slender cantilever under a sine at its tip, as strongly damped as materials may be.
LENGTH, DAMPING = 1.0, 2e-3
STRIP = bd.Section.rectangle(
    bd.Material(E=2.1e11, nu=0.3, rho=7850.0), width=0.02, height=0.002, damping=DAMPING
)
FREQUENCIES = (0.9, 1.6, 8.0)


def receptance(frequency: float) -> complex:
    """Of the tip: Bernoulli's beam with the stiffness EI (1 + i omega damping)."""
    omega = 2.0 * np.pi * frequency
    bending = STRIP.EI * (1.0 + 1j * omega * STRIP.damping)
    k = (STRIP.rhoA * omega**2 / bending) ** 0.25
    c, s, ch, sh = (f(k * LENGTH) for f in (np.cos, np.sin, np.cosh, np.sinh))
    return complex((s * ch - c * sh) / (bending * k**3 * (1.0 + c * ch)))


def _shaken() -> dict[str, float]:
    found = {}
    for frequency in FREQUENCIES:
        mech = bd.Mechanism()
        line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
        beam = mech.add(bd.Beam("beam", line, STRIP, elements=4, formulation="exact"))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        # By 1e-4 of its length: what is not linear is the square of that.
        size = 1e-4 * LENGTH / abs(receptance(frequency))
        mech.add(bd.Force("load", beam.end, (0.0, bd.sine(size, frequency))))
        mech.observe("tip", beam.end)
        motion = bd.periodic(mech, 1.0 / frequency, bd.Radau(1e-8))
        amplitude = motion.amplitudes().loc["tip.y [m]", "half range"]
        found[_at(frequency)] = float(amplitude) / size
    return found


def _at(frequency: float) -> str:
    return f"amplitude / load at {frequency:g} Hz"


def _mathieu() -> dict[str, float]:
    """At the edge of the first instability, where both multipliers are -1."""
    found = {}
    for q in (0.2, 1.0, 5.0):
        t, x, v = (ca.SX.sym(name) for name in "txv")
        force = -(mathieu_b(1, q) - 2.0 * q * ca.cos(2.0 * t)) * x
        system = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[0.0], v0=[0.0])
        found[f"sum of multipliers, q = {q:g}"] = float(
            bd.periodic(system, np.pi).multipliers.sum().real
        )
    return found


# A slider-crank of a short crank, and a rod of little damping.
ROD_LENGTH, CRANK = 0.5, 5e-5
ROD = bd.Section.rectangle(
    bd.Material(E=2.1e11, nu=0.3, rho=7850.0), width=0.02, height=0.001, damping=2e-3
)
FIRST = (np.pi / ROD_LENGTH) ** 2 * np.sqrt(ROD.EI / ROD.rhoA)
SPEEDS = 0.9 * FIRST, 1.1 * FIRST


def deflection(speed: float) -> float:
    """Amplitude in the middle of the rod, over the crank: sum of its modes between hinges.

    What swings it is its own inertia, rho A speed^2 crank (1 - s / L) sin(speed t).
    """
    n = np.arange(1, 400)
    natural = (n**2 * FIRST) ** 2 * (1.0 + 1j * speed * ROD.damping)
    shares = 2.0 / (n * np.pi) * speed**2 / (natural - speed**2)
    return float(np.abs(shares @ np.sin(0.5 * n * np.pi)))


@bd.model(t_end=1.0)
def slider_crank(speed: float = 1.0) -> bd.Mechanism:
    """An elastic rod on a crank that turns at `speed` [rad/s]."""
    mech = bd.Mechanism()
    crank = mech.add(bd.RigidBody("crank", 1.0, 1e-3))
    line = bd.Line((CRANK, 0.0), (CRANK + ROD_LENGTH, 0.0))
    rod = mech.add(bd.Beam("rod", line, ROD, elements=2, strain="exact"))
    axle = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("axle", axle, crank.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", axle, crank.at(0.0, 0.0), lambda t: speed * t))
    mech.add(bd.Revolute("crank pin", crank.at(CRANK, 0.0), rod.start))
    mech.add(bd.PointOnLine("guide", axle, rod.end, (1.0, 0.0)))
    mech.observe("middle", rod.deformation(0.5 * ROD_LENGTH, axes="local"))
    return mech


def _cranked() -> dict[str, float]:
    response = bd.frequency_response(
        slider_crank, "speed", SPEEDS, lambda speed: 2.0 * np.pi / speed, bd.Radau(1e-7)
    )
    ((speed, amplitude),) = response.peaks("middle.v [m]")
    return {"speed of the peak": speed / FIRST, "deflection / crank": amplitude / CRANK}


def _known_peak() -> dict[str, float]:
    found = minimize_scalar(lambda speed: -deflection(speed), bounds=SPEEDS, method="bounded")
    return {"speed of the peak": float(found.x / FIRST), "deflection / crank": float(-found.fun)}


KNOWN_PERIODIC = (
    KnownPeriodic(
        "shaken cantilever",
        "Bernoulli's beam with viscous damping of the material",
        {_at(frequency): abs(receptance(frequency)) for frequency in FREQUENCIES},
        1e-4,
        _shaken,
    ),
    KnownPeriodic(
        "Mathieu",
        "characteristic values b_1(q) of Mathieu's equation",
        {f"sum of multipliers, q = {q:g}": -2.0 for q in (0.2, 1.0, 5.0)},
        1e-5,
        _mathieu,
    ),
    KnownPeriodic(
        "peak of a slider-crank over its speed",
        "modes of the rod between hinges, of a short crank",
        _known_peak(),
        1e-3,
        _cranked,
    ),
)
