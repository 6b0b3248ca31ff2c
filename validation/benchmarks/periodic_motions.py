"""Periodic motions with closed-form references or references from special functions."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from benchmarks.reference_case import ReferenceCase
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar
from scipy.special import ellipk, mathieu_a, mathieu_b

import beamdae as bd

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


def _solve_shaken_cantilever(frequency: float) -> float:
    mech = bd.Mechanism()
    line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
    beam = mech.add(bd.Beam("beam", line, STRIP, elements=4, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    # At a deflection of 1e-4 of the length, nonlinear effects are of order 1e-8.
    size = 1e-4 * LENGTH / abs(tip_receptance(frequency))
    mech.add(bd.Force("load", beam.end, (0.0, bd.sine(size, frequency))))
    mech.observe("tip", beam.end)
    motion = bd.periodic(mech, 1.0 / frequency, bd.Radau(1e-8))
    return float(motion.amplitudes().loc["tip.y [m]", "half range"]) / size


def _oscillator(force: Callable[[Any, Any, Any], Any], q0: float = 0.0) -> bd.ConstrainedSystem:
    """Return the system x'' = force(t, x, x') of unit mass, at rest at `q0`."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force(t, x, v), q0=[q0], v0=[0.0])


# Mathieu's equation x'' + (a - 2 q cos 2 t) x = 0: a, q, and the sum of the multipliers, which are
# both 1 or -1 at undamped stability boundaries.
_FIRST = {f"q = {q:g}": (float(mathieu_b(1, q)), q, -2.0) for q in (0.2, 1.0, 5.0)}
_OTHERS = {
    f"{name}, q = {q:g}": (float(value(order, q)), q, sign)
    for q in (0.2, 5.0)
    for name, value, order, sign in (
        ("a_0", mathieu_a, 0, 2.0),
        ("a_1", mathieu_a, 1, -2.0),
        ("b_2", mathieu_b, 2, 2.0),
        ("a_2", mathieu_a, 2, 2.0),
    )
}


def _sum_of_multipliers(stiffness: Callable[[Any], Any]) -> float:
    system = _oscillator(lambda t, x, v: -stiffness(t) * x)
    return float(bd.periodic(system, np.pi).multipliers.sum().real)


def _solve_mathieu(a: float, q: float, sign: float) -> float:
    return _sum_of_multipliers(lambda t: a - 2.0 * q * ca.cos(2.0 * t))


# Hill's equation x'' + (a + cos 2 t + 0.4 sin 4 t) x = 0, undamped.
HILL_CONSTANTS = (0.3, 1.2, 4.1)


def _hill_stiffness(a: float, functions: Any, t: Any) -> Any:
    return a + functions.cos(2.0 * t) + 0.4 * functions.sin(4.0 * t)


def _reference_hill(a: float) -> float:
    """Return the trace of the fundamental matrix by an explicit method of order 8."""

    def slope(t: float, y: Array) -> list[float]:
        return [y[1], -_hill_stiffness(a, np, t) * y[0], y[3], -_hill_stiffness(a, np, t) * y[2]]

    start = [1.0, 0.0, 0.0, 1.0]
    end = solve_ivp(slope, (0.0, np.pi), start, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    return float(end[0] + end[3])


# Free undamped vibrations x'' + x + x^3 = 0 at these amplitudes.
BACKBONE_AMPLITUDES = (0.1, 1.0, 5.0)


def _backbone_period(amplitude: float) -> float:
    """Return the exact period of x'' + x + x^3 = 0 by the elliptic integral."""
    stiffness = 1.0 + amplitude**2
    return float(4.0 * ellipk(0.5 * amplitude**2 / stiffness) / np.sqrt(stiffness))


def _solve_backbone(amplitude: float) -> float:
    """Return the period over the exact period at the amplitude that was found."""
    system = _oscillator(lambda t, x, v: -x - x**3, amplitude)
    motion = bd.periodic(system, period_guess=_backbone_period(amplitude) * 1.1)
    first = motion.solution.trajectory.at(np.zeros(1))[1]
    q, v = first.q[0, 0], first.v[0, 0]
    energy = float(v**2 + q**2 + 0.5 * q**4)
    found = float(np.sqrt(np.sqrt(1.0 + 2.0 * energy) - 1.0))
    return motion.period / _backbone_period(found)


# Self-excited motions x'' = mu (1 - x^2) x' - x.
SELF_EXCITATIONS = (0.1, 1.0, 10.0)
_CYCLE_TIME = 200.0  # after which the motion at mu = 0.1 is periodic within 1e-9


def _solve_self_excited(mu: float) -> float:
    system = _oscillator(lambda t, x, v: mu * (1.0 - x**2) * v - x, 1.0)
    return bd.periodic(system, period_guess=2.0 * np.pi + 1.6 * mu, settle=8).period


def _reference_cycle(mu: float) -> float:
    """Return the time between upward zero crossings by an explicit method of order 8."""

    def slope(t: float, y: Array) -> list[float]:
        return [y[1], mu * (1.0 - y[0] ** 2) * y[1] - y[0]]

    def crosses_upward(t: float, y: Array) -> float:
        return float(y[0])

    crosses_upward.direction = 1.0  # type: ignore[attr-defined]
    accuracy = {"rtol": 1e-13, "atol": 1e-13, "events": crosses_upward}
    run = solve_ivp(slope, (0.0, _CYCLE_TIME), [2.0, 0.0], "DOP853", **accuracy)
    return float(np.diff(run.t_events[0])[-1])


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


def _case(
    name: str,
    source: str,
    tolerance: float,
    label: str,
    settings: Mapping[str, tuple[Any, ...]],
    reference: Callable[..., float],
    compute: Callable[..., float],
) -> ReferenceCase:
    """Return a case of one value for each setting."""
    functions = (
        lambda f=f: {f"{label}{key}": f(*arguments) for key, arguments in settings.items()}
        for f in (reference, compute)
    )
    return ReferenceCase(name, source, tolerance, *functions)


PERIODIC_CASES = (
    _case(
        "shaken cantilever",
        "Bernoulli's beam with viscous damping of the material",
        1e-4,
        "amplitude / load at ",
        {f"{x:g} Hz": (x,) for x in FREQUENCIES},
        lambda frequency: abs(tip_receptance(frequency)),
        _solve_shaken_cantilever,
    ),
    _case(
        "Mathieu",
        "characteristic values b_1(q) of Mathieu's equation",
        1e-5,
        "sum of multipliers, ",
        _FIRST,
        lambda a, q, sign: sign,
        _solve_mathieu,
    ),
    _case(
        "Mathieu, undamped boundaries",
        "characteristic values a_0, a_1, b_2 and a_2 of Mathieu's equation",
        1e-5,
        "sum of multipliers at ",
        _OTHERS,
        lambda a, q, sign: sign,
        _solve_mathieu,
    ),
    _case(
        "Hill, undamped",
        "trace of the fundamental matrix by scipy's DOP853",
        1e-5,
        "sum of multipliers, ",
        {f"a = {a:g}": (a,) for a in HILL_CONSTANTS},
        _reference_hill,
        lambda a: _sum_of_multipliers(partial(_hill_stiffness, a, ca)),
    ),
    _case(
        "Duffing backbone",
        "elliptic integral of the first kind",
        1e-6,
        "period / exact at ",
        {f"amplitude {x:g}": (x,) for x in BACKBONE_AMPLITUDES},
        lambda amplitude: 1.0,
        _solve_backbone,
    ),
    _case(
        "van der Pol",
        "time between zero crossings by scipy's DOP853",
        1e-7,
        "period, ",
        {f"mu = {mu:g}": (mu,) for mu in SELF_EXCITATIONS},
        _reference_cycle,
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
