"""Constrained mechanics with published or closed-form answers, none of them by this project."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import ellipk
from tolerances.constrained_systems import arevalo, car_axis

import beamdae as bd

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class PublishedCase:
    """A system, and what is known of its motion.

    `answer(t)` gives rows of whatever is known at times t by name: "q", "v", "lam" with the
    multipliers in beamdae's sign, M q'' + G^T lam = f. `times` are where it is known; `rate` is
    the fastest angular rate of the motion [rad/s].
    """

    name: str
    source: str
    build: Callable[[], bd.ConstrainedSystem]
    times: tuple[float, ...]
    rate: float
    answer: Callable[[Array], dict[str, Array]]

    @cached_property
    def equations(self) -> bd.EquationsOfMotion:
        return self.build().equations

    @property
    def t_end(self) -> float:
        return self.times[-1]

    def run(self, integrator: Any) -> bd.Solution:
        """Solution with output at the first of `times` and its multiples."""
        solution = bd.simulate(self.equations, integrator, self.t_end, output_step=self.times[0])
        assert solution.status.success, solution.status.sentence
        return solution

    def errors(self, solution: bd.Solution) -> dict[str, float]:
        """Largest error at `times` of each thing known."""
        known = self.answer(np.array(self.times))
        rows = np.searchsorted(solution.t, np.array(self.times) - 1e-9)
        found = {"q": solution.q, "v": solution.v, "lam": solution.lam}
        return {name: float(np.max(np.abs(found[name][rows] - known[name]))) for name in known}


def _symbols(n: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    return ca.SX.sym("t"), ca.SX.sym("q", n), ca.SX.sym("v", n)


def _car_axis_answer(t: Array) -> dict[str, Array]:
    # The published multipliers stand on the right-hand side.
    return {
        "q": np.array(
            [
                [
                    0.493455784275402809122e-1,
                    0.496989460230171153861,
                    0.104174252488542151681e1,
                    0.373911027265361256927,
                ]
            ]
        ),
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
    # The springs shake masses of 5e-4 with a stiffness of 1.
    np.sqrt(1.0 / 5e-4),
    _car_axis_answer,
)


def _arevalo_answer(t: Array) -> dict[str, Array]:
    x, y = np.sin(t**2), np.cos(t**2)
    rate = 2.0 * t
    return {
        "q": np.stack([x, y], axis=-1),
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
    t, q, v = _symbols(2)
    return bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=ca.vertcat(0.0, -gravity),
        constraints=0.5 * (ca.sumsqr(q) - 1.0),
        q0=[np.sin(angle), -np.cos(angle)],
        v0=[speed * np.cos(angle), speed * np.sin(angle)],
        names=("x", "y"),
    )


def pendulum_motion(gravity: float, angle: float, speed: float, t: Array) -> dict[str, Array]:
    """The same by an independent code, in the one coordinate it needs."""
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


# From the horizontal a quarter of the period is sqrt(l/g) K(1/sqrt 2): this makes the period 2 s.
PERIOD_TWO_GRAVITY = 4.0 * float(ellipk(0.5)) ** 2


def _period_two_answer(t: Array) -> dict[str, Array]:
    """Ends of the swing at whole seconds, its lowest point between them."""
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
    lambda t: {"q": np.array([[-0.275087462577, -0.961419205099]])},
)


def _slider_crank() -> bd.ConstrainedSystem:
    t, u, v = _symbols(3)
    q, x, p = u[0], u[1], u[2]
    a, j_1, j_2, m_2 = 0.5, 1.0, 2.0, 1.0
    stiffness, damping, rest, pull = 1.0, 1.0, 1.0, 1.0

    crank = 0.5 * a * ca.vertcat(ca.cos(q), ca.sin(q))
    rod = ca.vertcat(x - 0.5 * ca.cos(p), -0.5 * ca.sin(p))
    length = ca.norm_2(rod - crank)
    tension = stiffness * (length - rest) + damping * ca.jtimes(length, u, v)
    push = pull * ca.jacobian(x + ca.cos(p), u).T
    return bd.ConstrainedSystem(
        t=t,
        q=u,
        v=v,
        mass=[j_1, m_2, j_2],
        force=push - tension * ca.jacobian(length, u).T,
        constraints=ca.vertcat(x - ca.cos(p) - a * ca.cos(q), -ca.sin(p) - a * ca.sin(q)),
        q0=[np.pi / 2.0, np.cos(np.arcsin(-a)), np.arcsin(-a)],
        v0=[0.0, 0.0, 0.0],
        names=("q", "x", "p"),
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
    _slider_crank,
    (2.5, 5.0, 7.5, 10.0),
    1.2,
    _slider_crank_answer,
)

PUBLISHED_CASES = (CAR_AXIS, AREVALO, PENDULUM, IFTOMM_PENDULUM, SLIDER_CRANK)
