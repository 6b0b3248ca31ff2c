"""Systems with published or closed-form motions from sources independent of this project."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from benchmarks.systems import (
    CAR_AXIS_END,
    IFTOMM_END,
    PERIOD_TWO_GRAVITY,
    arevalo,
    arevalo_motion,
    car_axis,
    cycloid_slide,
    knife_edge,
    parallelogram,
    particle_pendulum,
    rotating_rod,
    spring_slider_crank,
)
from scipy.integrate import solve_ivp

import beamdae as bd

Array = np.ndarray


def cycloid_motion(t: Array) -> dict[str, Array]:
    radius, gravity, start = 0.5, 9.81, -0.95
    # The sine of the slope, s / 4r, oscillates harmonically.
    omega = np.sqrt(gravity / (4.0 * radius))
    sine = start * np.cos(omega * t)
    rate = -omega * start * np.sin(omega * t)
    acceleration = -(omega**2) * sine
    cosine = np.sqrt(1.0 - sine**2)
    x = 2.0 * radius * (np.arcsin(sine) + sine * cosine)
    rates = 4.0 * radius * np.stack([cosine * rate, sine * rate, rate], axis=-1)
    pull_x = 4.0 * radius * (cosine * acceleration - sine / cosine * rate**2)
    pull_y = 4.0 * radius * (sine * acceleration + rate**2)
    return {
        "q": np.stack([x, 2.0 * radius * sine**2, 4.0 * radius * sine], axis=-1),
        "v": rates,
        "lam": -np.stack([pull_x, pull_y + gravity], axis=-1),
    }


def rotating_rod_motion(t: Array) -> dict[str, Array]:
    radius, omega = 0.1, 2.0
    r, rate = radius * np.cosh(omega * t), omega * radius * np.sinh(omega * t)
    along = np.stack([np.cos(omega * t), np.sin(omega * t)], axis=-1)
    across = np.stack([-np.sin(omega * t), np.cos(omega * t)], axis=-1)
    return {
        "q": r[:, None] * along,
        "v": rate[:, None] * along + (omega * r)[:, None] * across,
        "lam": -2.0 * omega * rate[:, None],
    }


def knife_edge_motion(t: Array) -> dict[str, Array]:
    pull, spin = 5.0, 2.0
    angle, size = spin * t, pull / (2.0 * spin**2)
    speed = pull / spin * np.sin(angle)
    x, y = size * np.sin(angle) ** 2, size * (angle - 0.5 * np.sin(2.0 * angle))
    return {
        "q": np.stack([x, y, angle], axis=-1),
        "v": np.stack([speed * np.cos(angle), speed * np.sin(angle), 0.0 * t + spin], axis=-1),
        "lam": 2.0 * pull * np.sin(angle)[:, None],
    }


def parallelogram_motion(t: Array) -> dict[str, Array]:
    crank, coupler, rate, start = 0.5, 1.0, 2.0, 0.3
    angle = start + rate * t
    pin = crank * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    pin_velocity = crank * rate * np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    rotation, spin = (angle - start)[:, None], np.full((len(t), 1), rate)
    span = np.array([coupler, 0.0])
    coupler_center, right_center, zero = pin + 0.5 * span, 0.5 * pin + span, np.zeros((len(t), 1))
    bars = (coupler_center, zero, 0.5 * pin, rotation, right_center, rotation)
    rates = (pin_velocity, zero, 0.5 * pin_velocity, spin, 0.5 * pin_velocity, spin)
    return {"q": np.hstack(bars), "v": np.hstack(rates)}


@dataclass(frozen=True, eq=False)
class PublishedCase:
    """A system and its published motion.

    Attributes
    ----------
    source
        Publication or closed form.
    build
        Creates the mechanism or constrained system.
    times
        Times at which the motion is known [s].
    rate
        Fastest angular rate of the motion [rad/s].
    answer
        Maps times to the known rows by name: "q", "v", "lam" in beamdae's sign convention,
        M q'' + G^T lam = f, or observed columns by their headers.
    model_error
        Effects that the mechanism includes and the answer neglects, relative to its size.
    """

    name: str
    source: str
    build: Callable[[], Any]
    times: tuple[float, ...]
    rate: float
    answer: Callable[[Array], dict[str, Array]]
    model_error: float = 0.0

    @cached_property
    def equations(self) -> bd.results.EquationsOfMotion:
        """Equations of motion of the system."""
        model = self.build()
        return bd.equations_of_motion(model) if isinstance(model, bd.Mechanism) else model.equations

    @property
    def t_end(self) -> float:
        """End of the run [s]."""
        return self.times[-1]

    def attempt(self, integrator: Any) -> bd.results.Solution:
        """Simulate with output at multiples of the first of `times`; the run may fail."""
        return bd.simulate(self.equations, integrator, self.t_end, output_step=self.times[0])

    def run(self, integrator: Any) -> bd.results.Solution:
        """Simulate with output at multiples of the first of `times`; a failed run raises."""
        solution = self.attempt(integrator)
        assert solution.status.success, solution.status.sentence
        return solution

    def compare(self, solution: bd.results.Solution) -> dict[str, tuple[Array, Array]]:
        """Return the published and the computed rows at `times` by name."""
        times = np.array(self.times)
        rows = np.searchsorted(solution.t, times - 1e-9)
        computed = {"q": solution.q, "v": solution.v, "lam": solution.lam, **solution.columns}
        return {
            name: (reference.reshape(len(times), -1), computed[name][rows].reshape(len(times), -1))
            for name, reference in self.answer(times).items()
        }

    def errors(self, solution: bd.results.Solution) -> dict[str, float]:
        """Return the largest error at `times` by name."""
        pairs = self.compare(solution)
        return {
            name: float(np.max(np.abs(x - reference))) for name, (reference, x) in pairs.items()
        }


def _car_axis_answer(t: Array) -> dict[str, Array]:
    # The published multipliers are on the right-hand side of the equations of motion.
    return {
        "q": np.array([list(CAR_AXIS_END.values())]),
        "v": np.array(
            [
                [
                    -0.770583684040972357970e-1,
                    0.744686658723778553466e-2,
                    0.175568157537232222276e-1,
                    0.770341043779251976443,
                ]
            ]
        ),
        "lam": -np.array([[-0.473688659084893324729e-2, -0.110468033125734368808e-2]]),
    }


CAR_AXIS = PublishedCase(
    "car axis",
    "Mazzia & Magherini, Test Set for Initial Value Problem Solvers, caraxis; "
    "cran/deTestSet R/ex_reference.R",
    car_axis,
    (3.0,),
    # Masses of 5e-4 on springs of stiffness 1.
    np.sqrt(1.0 / 5e-4),
    _car_axis_answer,
)


def _arevalo_answer(t: Array) -> dict[str, Array]:
    q = arevalo_motion(t)
    x, y = q.T
    rate = 2.0 * t
    return {
        "q": q,
        "v": np.stack([rate * y, -rate * x], axis=-1),
        "lam": (4.0 * t**2)[:, None],
    }


AREVALO = PublishedCase(
    "Arevalo",
    "Arevalo & Loetstedt, BIT 35 (1995) 1; JonasBreuling/scipy_dae examples/daes/arevalo.py",
    arevalo,
    (0.5, 1.0, 1.5, 2.0),
    4.0,
    _arevalo_answer,
)


def pendulum(gravity: float, angle: float, speed: float = 0.0) -> bd.ConstrainedSystem:
    """Point of unit mass on a circle of unit radius; `angle` from the downward vertical."""
    return particle_pendulum(gravity=gravity, angle=angle, speed=speed)


def pendulum_motion(gravity: float, angle: float, speed: float, t: Array) -> dict[str, Array]:
    """Return the motion of `pendulum`, integrated in the angle by independent code."""
    motion = solve_ivp(
        lambda _, y: [y[1], -gravity * np.sin(y[0])],
        (0.0, t[-1]),
        [angle, speed],
        method="DOP853",
        t_eval=t,
        rtol=1e-13,
        atol=1e-13,
    )
    theta, omega = motion.y
    q = np.stack([np.sin(theta), -np.cos(theta)], axis=-1)
    v = omega[:, None] * np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    return {"q": q, "v": v, "lam": (omega**2 + gravity * np.cos(theta))[:, None]}


def _period_two_answer(t: Array) -> dict[str, Array]:
    """Return the motion at multiples of half a second: the reversals and the lowest point."""
    phase = np.pi * t
    speed = np.sqrt(2.0 * PERIOD_TWO_GRAVITY)
    height = -np.abs(np.sin(phase))
    velocity = np.stack([-speed * np.sin(phase), np.zeros_like(t)], axis=-1)
    return {
        "q": np.stack([np.cos(phase), height], axis=-1),
        "v": velocity,
        "lam": -3.0 * PERIOD_TWO_GRAVITY * height[:, None],
    }


PENDULUM = PublishedCase(
    "pendulum",
    "closed form: the period of a pendulum released from the horizontal, 4 sqrt(l/g) K(1/sqrt 2)",
    lambda: pendulum(PERIOD_TWO_GRAVITY, 0.5 * np.pi),
    tuple(0.5 * k for k in range(1, 9)),
    np.sqrt(2.0 * PERIOD_TWO_GRAVITY),
    _period_two_answer,
)


IFTOMM_PENDULUM = PublishedCase(
    "IFToMM A01",
    "IFToMM multibody benchmark A01, simple pendulum; Exudyn Examples/pendulumIftommBenchmark.py. "
    "The digits are those of the pendulum's elliptic integral",
    lambda: pendulum(9.81, -0.5 * np.pi),
    (10.0,),
    np.sqrt(2.0 * 9.81),
    lambda t: {"q": np.array([list(IFTOMM_END.values())])},
)


def _slider_crank_answer(t: Array) -> dict[str, Array]:
    return {
        "q": np.array(
            [
                [0.072236105466, 1.498044718150, -0.036094486808],
                [-1.429996967647, 0.939030613578, 0.517894756490],
                [0.180418466694, 1.487851315824, -0.089841441982],
                [1.275675848650, 1.023578558980, -0.498813049183],
            ]
        )
    }


SLIDER_CRANK = PublishedCase(
    "SUNDIALS slider crank",
    "LLNL/sundials examples/ida/serial/idaSlCrank_dns.c and .out (five digits, e.g. at t = 10: "
    "1.2757, 1.0236, -0.49881); twelve digits by Runge-Kutta in the crank angle alone",
    spring_slider_crank,
    (2.5, 5.0, 7.5, 10.0),
    1.2,
    _slider_crank_answer,
)


CYCLOID = PublishedCase(
    "brachistochrone",
    "closed form (Huygens 1673): the arc length from the lowest point of a cycloid of radius r "
    "oscillates at sqrt(g / 4r); the descent takes pi sqrt(r / g) from any height",
    cycloid_slide,
    tuple(0.25 * np.pi * np.sqrt(0.5 / 9.81) * k for k in range(1, 17)),
    # At the reversals the curve is ten times as steep as at the lowest point.
    4.0 * np.sqrt(9.81 / 2.0),
    cycloid_motion,
)


ROTATING_ROD = PublishedCase(
    "mass on a rotating rod",
    "closed form: r = r0 cosh(w t), with the reaction 2 m w r'",
    rotating_rod,
    tuple(0.25 * k for k in range(1, 9)),
    # The motion is a sum of exp(w t (1 +- i)).
    2.0 * np.sqrt(2.0),
    rotating_rod_motion,
)


KNIFE_EDGE = PublishedCase(
    "knife edge",
    "closed form (Bloch 2003): it slides down and up again on a cycloid across the slope",
    knife_edge,
    tuple(0.25 * k for k in range(1, 17)),
    # The motion along the slope has twice the frequency of the rotation.
    4.0,
    knife_edge_motion,
)


PARALLELOGRAM = PublishedCase(
    "parallelogram linkage",
    "closed form: without gravity its cranks turn at a constant rate, through its change points",
    parallelogram,
    tuple(0.25 * k for k in range(1, 13)),
    2.0,
    parallelogram_motion,
)

PUBLISHED_CASES = (
    CAR_AXIS,
    AREVALO,
    PENDULUM,
    IFTOMM_PENDULUM,
    SLIDER_CRANK,
    CYCLOID,
    ROTATING_ROD,
    KNIFE_EDGE,
)
