"""Periodic motions with closed-form references or references from special functions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar
from scipy.special import ellipk, mathieu_a, mathieu_b

import beamdae as bd
from benchmarks.reference_case import ReferenceCase

Array = np.ndarray


# A slender cantilever under a sinusoidal tip force, with strong material damping.
LENGTH = 1.0  # [m]
DAMPING = 2e-3  # Kelvin-Voigt time [s]
STRIP = bd.Section.rectangle(
    bd.Material(E=2.1e11, nu=0.3, rho=7850.0), width=0.02, height=0.002, damping=DAMPING
)
FREQUENCIES = (0.9, 1.6, 8.0)  # [Hz]


def tip_receptance(frequency: float) -> complex:
    """Return the tip receptance [m/N] of Bernoulli's beam with EI (1 + i omega damping)."""
    omega = 2.0 * np.pi * frequency
    bending = STRIP.EI * (1.0 + 1j * omega * STRIP.damping)
    k = (STRIP.rhoA * omega**2 / bending) ** 0.25
    c, s, ch, sh = (f(k * LENGTH) for f in (np.cos, np.sin, np.cosh, np.sinh))
    return complex((s * ch - c * sh) / (bending * k**3 * (1.0 + c * ch)))


def _solve_shaken_cantilever() -> dict[str, float]:
    values = {}
    for frequency in FREQUENCIES:
        mech = bd.Mechanism()
        line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
        beam = mech.add(bd.Beam("beam", line, STRIP, elements=4, formulation="exact"))
        mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
        # At a deflection of 1e-4 of the length, nonlinear effects are of order 1e-8.
        size = 1e-4 * LENGTH / abs(tip_receptance(frequency))
        mech.add(bd.Force("load", beam.end, (0.0, bd.sine(size, frequency))))
        mech.observe("tip", beam.end)
        motion = bd.periodic(mech, 1.0 / frequency, bd.Radau(1e-8))
        amplitude = motion.amplitudes().loc["tip.y [m]", "half range"]
        values[_amplitude_label(frequency)] = float(amplitude) / size
    return values


def _amplitude_label(frequency: float) -> str:
    return f"amplitude / load at {frequency:g} Hz"


def _solve_mathieu() -> dict[str, float]:
    """Return sums of multipliers at the first instability boundary, where both are -1."""
    values = {}
    for q in (0.2, 1.0, 5.0):
        t, x, v = (ca.SX.sym(name) for name in "txv")
        force = -(mathieu_b(1, q) - 2.0 * q * ca.cos(2.0 * t)) * x
        system = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[0.0], v0=[0.0])
        values[f"sum of multipliers, q = {q:g}"] = float(
            bd.periodic(system, np.pi).multipliers.sum().real
        )
    return values


# Undamped stability boundaries of Mathieu's equation, where both multipliers are 1 or -1.
BOUNDARIES = {
    f"sum of multipliers at {name}, q = {q:g}": (float(value(order, q)), q, sign)
    for q in (0.2, 5.0)
    for name, value, order, sign in (
        ("a_0", mathieu_a, 0, 2.0),
        ("a_1", mathieu_a, 1, -2.0),
        ("b_2", mathieu_b, 2, 2.0),
        ("a_2", mathieu_a, 2, 2.0),
    )
}


def _parametric_system(stiffness: Callable[[Any], Any]) -> bd.ConstrainedSystem:
    """Return the system x'' + stiffness(t) x = 0 at rest."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=-stiffness(t) * x, q0=[0.0], v0=[0.0])


def _sum_of_multipliers(stiffness: Callable[[Any], Any], period: float) -> float:
    return float(bd.periodic(_parametric_system(stiffness), period).multipliers.sum().real)


def _mathieu_stiffness(a: float, q: float, t: Any) -> Any:
    return a - 2.0 * q * ca.cos(2.0 * t)


def _solve_boundaries() -> dict[str, float]:
    return {
        name: _sum_of_multipliers(partial(_mathieu_stiffness, a, q), np.pi)
        for name, (a, q, _) in BOUNDARIES.items()
    }


# Hill's equation x'' + (a + cos 2 t + 0.4 sin 4 t) x = 0, undamped.
HILL_CONSTANTS = (0.3, 1.2, 4.1)


def _hill_stiffness(a: float, functions: Any, t: Any) -> Any:
    return a + functions.cos(2.0 * t) + 0.4 * functions.sin(4.0 * t)


def _solve_hill() -> dict[str, float]:
    return {
        f"sum of multipliers, a = {a:g}": _sum_of_multipliers(
            partial(_hill_stiffness, a, ca), np.pi
        )
        for a in HILL_CONSTANTS
    }


def _reference_hill() -> dict[str, float]:
    """Return traces of the fundamental matrix by an explicit method of order 8."""
    traces = {}
    for a in HILL_CONSTANTS:
        columns = [
            solve_ivp(
                lambda t, y, a=a: [y[1], -_hill_stiffness(a, np, t) * y[0]],
                (0.0, np.pi),
                start,
                method="DOP853",
                rtol=1e-13,
                atol=1e-13,
            ).y[:, -1]
            for start in ([1.0, 0.0], [0.0, 1.0])
        ]
        traces[f"sum of multipliers, a = {a:g}"] = float(columns[0][0] + columns[1][1])
    return traces


# Free undamped vibrations x'' + x + x^3 = 0 at these amplitudes.
BACKBONE_AMPLITUDES = (0.1, 1.0, 5.0)


def _backbone_period(amplitude: float) -> float:
    """Return the exact period of x'' + x + x^3 = 0 by the elliptic integral."""
    stiffness = 1.0 + amplitude**2
    return float(4.0 * ellipk(0.5 * amplitude**2 / stiffness) / np.sqrt(stiffness))


def _solve_backbone() -> dict[str, float]:
    """Return periods over the exact period at the amplitude that was found."""
    values = {}
    for amplitude in BACKBONE_AMPLITUDES:
        t, x, v = (ca.SX.sym(name) for name in "txv")
        system = bd.ConstrainedSystem(
            t, x, v, mass=[1.0], force=-x - x**3, q0=[amplitude], v0=[0.0]
        )
        motion = bd.periodic(system, period_guess=_backbone_period(amplitude) * 1.1)
        first = motion.solution.trajectory.at(np.zeros(1))[1]
        q, v = first.q[0, 0], first.v[0, 0]
        energy = float(v**2 + q**2 + 0.5 * q**4)
        found = float(np.sqrt(np.sqrt(1.0 + 2.0 * energy) - 1.0))
        values[_backbone_label(amplitude)] = motion.period / _backbone_period(found)
    return values


def _backbone_label(amplitude: float) -> str:
    return f"period / exact at amplitude {amplitude:g}"


# Self-excited motions x'' = mu (1 - x^2) x' - x.
SELF_EXCITATIONS = (0.1, 1.0, 10.0)
_CYCLE_TIME = 200.0  # after which the motion at mu = 0.1 is periodic within 1e-9


def _cycle_label(mu: float) -> str:
    return f"period, mu = {mu:g}"


def _solve_self_excited() -> dict[str, float]:
    values = {}
    for mu in SELF_EXCITATIONS:
        t, x, v = (ca.SX.sym(name) for name in "txv")
        force = mu * (1.0 - x**2) * v - x
        system = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[1.0], v0=[0.0])
        guess = 2.0 * np.pi + 1.6 * mu
        values[_cycle_label(mu)] = bd.periodic(system, period_guess=guess, settle=8).period
    return values


def _reference_cycles() -> dict[str, float]:
    """Return times between upward zero crossings by an explicit method of order 8."""

    def crosses_upward(t: float, y: Array) -> float:
        return float(y[0])

    crosses_upward.direction = 1.0  # type: ignore[attr-defined]
    periods = {}
    for mu in SELF_EXCITATIONS:
        run = solve_ivp(
            lambda t, y, mu=mu: [y[1], mu * (1.0 - y[0] ** 2) * y[1] - y[0]],
            (0.0, _CYCLE_TIME),
            [2.0, 0.0],
            method="DOP853",
            rtol=1e-13,
            atol=1e-13,
            events=crosses_upward,
        )
        periods[_cycle_label(mu)] = float(np.diff(run.t_events[0])[-1])
    return periods


# A slider-crank with a short crank and a lightly damped rod.
ROD_LENGTH = 0.5  # [m]
CRANK = 5e-5  # length [m]
ROD = bd.Section.rectangle(
    bd.Material(E=2.1e11, nu=0.3, rho=7850.0), width=0.02, height=0.001, damping=2e-3
)
FIRST_FREQUENCY = (np.pi / ROD_LENGTH) ** 2 * np.sqrt(ROD.EI / ROD.rhoA)
# Range of crank speeds [rad/s].
SPEEDS = 0.9 * FIRST_FREQUENCY, 1.1 * FIRST_FREQUENCY


def midpoint_amplitude(speed: float) -> float:
    """Return the amplitude at midspan over the crank length, summed over the hinged modes.

    The excitation is the inertia rho A speed^2 crank (1 - s / L) sin(speed t) of the rod.
    """
    n = np.arange(1, 400)
    natural = (n**2 * FIRST_FREQUENCY) ** 2 * (1.0 + 1j * speed * ROD.damping)
    modal_amplitudes = 2.0 / (n * np.pi) * speed**2 / (natural - speed**2)
    return float(np.abs(modal_amplitudes @ np.sin(0.5 * n * np.pi)))


@bd.model(t_end=1.0)
def slider_crank(speed: float = 1.0) -> bd.Mechanism:
    """Return an elastic rod on a crank that turns at `speed` [rad/s]."""
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


def _solve_slider_crank() -> dict[str, float]:
    response = bd.frequency_response(
        slider_crank,
        "speed",
        SPEEDS,
        lambda speed: 2.0 * np.pi / speed,
        bd.Radau(1e-7),
        step=0.01,
        max_step=0.05,
    )
    ((speed, amplitude),) = response.peaks("middle.v [m]")
    return {"speed of the peak": speed / FIRST_FREQUENCY, "deflection / crank": amplitude / CRANK}


def _reference_peak() -> dict[str, float]:
    peak = minimize_scalar(
        lambda speed: -midpoint_amplitude(speed), bounds=SPEEDS, method="bounded"
    )
    return {
        "speed of the peak": float(peak.x / FIRST_FREQUENCY),
        "deflection / crank": float(-peak.fun),
    }


PERIODIC_CASES = (
    ReferenceCase(
        "shaken cantilever",
        "Bernoulli's beam with viscous damping of the material",
        1e-4,
        lambda: {
            _amplitude_label(frequency): abs(tip_receptance(frequency)) for frequency in FREQUENCIES
        },
        _solve_shaken_cantilever,
    ),
    ReferenceCase(
        "Mathieu",
        "characteristic values b_1(q) of Mathieu's equation",
        1e-5,
        lambda: {f"sum of multipliers, q = {q:g}": -2.0 for q in (0.2, 1.0, 5.0)},
        _solve_mathieu,
    ),
    ReferenceCase(
        "Mathieu, undamped boundaries",
        "characteristic values a_0, a_1, b_2 and a_2 of Mathieu's equation",
        1e-5,
        lambda: {name: sign for name, (_, _, sign) in BOUNDARIES.items()},
        _solve_boundaries,
    ),
    ReferenceCase(
        "Hill, undamped",
        "trace of the fundamental matrix by scipy's DOP853",
        1e-5,
        _reference_hill,
        _solve_hill,
    ),
    ReferenceCase(
        "Duffing backbone",
        "elliptic integral of the first kind",
        1e-6,
        lambda: {_backbone_label(amplitude): 1.0 for amplitude in BACKBONE_AMPLITUDES},
        _solve_backbone,
    ),
    ReferenceCase(
        "van der Pol",
        "time between zero crossings by scipy's DOP853",
        1e-7,
        _reference_cycles,
        _solve_self_excited,
    ),
    ReferenceCase(
        "peak of a slider-crank over its speed",
        "modes of the rod between hinges, of a short crank",
        1e-3,
        _reference_peak,
        _solve_slider_crank,
    ),
)
