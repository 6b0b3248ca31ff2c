"""One step of the generalized-alpha family: its members, its start, its changes of the step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from beamdae.equations.consistent_start import Starter
from beamdae.equations.formulations import State
from beamdae.integrators.modified_newton import ModifiedNewton
from beamdae.results.solution import Statistics

Array = np.ndarray

FAMILIES = ("generalized-alpha", "hht", "newmark")


class Parameters(NamedTuple):
    """A member of the family.

    (1 - alpha_m) a_{n+1} + alpha_m a_n = (1 - alpha_f) q''_{n+1} + alpha_f q''_n,
    q_{n+1} = q_n + h v_n + h^2 ((1/2 - beta) a_n + beta a_{n+1}),
    v_{n+1} = v_n + h ((1 - gamma) a_n + gamma a_{n+1}).

    `shift` says what a_n stands for: q'' at t_n + shift h, up to h^2. Put into the first formula,
    that asks for shift = alpha_m - alpha_f; where constraints prescribe q, the third one makes
    it 1/2 - gamma. Both agree in the members of second order.
    """

    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    shift: float

    @property
    def defect(self) -> float:
        """What a step of q lacks, over h^3 q''': 1/6 - shift/2 - beta.

        From a_n = q'' + shift h q''' and a_{n+1} = q'' + (1 + shift) h q''' in the second formula.
        """
        return 1.0 / 6.0 - 0.5 * self.shift - self.beta


def parameters(family: str, rho_inf: float) -> Parameters:
    """The member of a family with the spectral radius `rho_inf` at infinite frequency.

    All three have gamma = (3 - rho_inf) / (2 (1 + rho_inf)) and beta = (gamma + 1/2)^2 / 4 and
    differ in the averages:

    =================  ===============================  =============================  ===========
    family             alpha_m                          alpha_f                        order
    =================  ===============================  =============================  ===========
    generalized-alpha  (2 rho_inf - 1) / (rho_inf + 1)  rho_inf / (rho_inf + 1)        2
    hht                0                                (1 - rho_inf) / (1 + rho_inf)  2
    newmark            0                                0                              1 (2 at 1)
    =================  ===============================  =============================  ===========

    Chung & Hulbert, J. Appl. Mech. 60 (1993) 371; Hilber, Hughes & Taylor, Earthq. Eng. Struct.
    Dyn. 5 (1977) 283; Newmark, J. Eng. Mech. Div. ASCE 85 (1959) 67. HHT has a second eigenvalue
    alpha_f / (1 - alpha_f) at infinity, the larger one below rho_inf = 1/2.
    """
    alpha_m = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0)
    alpha_f = rho_inf / (rho_inf + 1.0)
    gamma = 0.5 + alpha_f - alpha_m
    beta = 0.25 * (gamma + 0.5) ** 2
    shift = alpha_m - alpha_f
    if family == "hht":
        alpha_m, alpha_f = 0.0, (1.0 - rho_inf) / (1.0 + rho_inf)
    elif family == "newmark":
        alpha_m = alpha_f = 0.0
    return Parameters(alpha_m, alpha_f, gamma, beta, shift)


class Motion(NamedTuple):
    """State after a step `h`; `a` is the algorithmic acceleration, `ddq` the one of the bodies."""

    q: Array
    v: Array
    ddq: Array
    a: Array
    lam: Array
    h: float

    @property
    def state(self) -> State:
        """What of it is a row of the trajectory."""
        return State(self.q, self.v, self.ddq, self.lam)


class Stepper:
    """Steps of one member on one form of the equations; keeps its factors while the step stays."""

    def __init__(
        self, member: Parameters, newton: ModifiedNewton, starter: Starter, index3: bool
    ) -> None:
        self._member = member
        self._newton = newton
        self._starter = starter
        self._index3 = index3
        self._x = np.zeros(newton.size)
        self._h = 0.0

    def start(self, time: Array, state: State, h: float, cured: bool) -> Motion:
        """Motion to start from at time = (t, branch) with the step `h`.

        Of the jerk only what the joints prescribe enters, and modes too stiff for the step respond
        to a load that is there at once as they would after the step: both would ring otherwise.
        """
        self._restart(h, state.lam)
        if not cured:
            return Motion(state.q, state.v, state.a, state.a, state.lam, h)
        jerk = self._starter.normal_jerk(time, state, 1e-2 * h)
        ddq, _ = self._starter.acceleration(time, state.q, state.v, stiff_time=0.5 * h)
        a = ddq + self._member.shift * h * jerk
        v = state.v + h**2 * self._member.defect * jerk if self._index3 else state.v
        return Motion(state.q, v, ddq, a, state.lam, h)

    def resume(self, time: Array, motion: Motion, h: float) -> Motion:
        """The motion as steps `h` would have brought it about; keeps second order.

        a_n = q''_n + shift h_n q''' + O(h^2) belongs to the step h_n that led to it: for h it is
        q''_n + (h / h_n) (a_n - q''_n). On index 3 positions are on the constraints after every
        step, although each lacks defect h^3 q''', because velocities are off by h_n^2 defect P q'''
        (P as in `Starter.normal_jerk`): that is made h^2 defect P q'''. Without the first, steps
        that change all the time are of first order; without the second, multipliers are after
        every change. Cf. Arnold, Hante & Koebis, PAMM 14 (2014) 27; Bruls & Arnold, J. Comput.
        Nonlinear Dyn. 3 (2008) 041007, let the parameters depend on the ratio of the steps instead.

        Raises
        ------
        BeamdaeError
            If the joints have become dependent on each other.
        """
        if math.isclose(h, motion.h):
            h = motion.h
        if h != self._h:
            self._restart(h, motion.lam)
        if h == motion.h:
            return motion
        a = motion.ddq + h / motion.h * (motion.a - motion.ddq)
        v = motion.v
        if self._index3:
            jerk = self._starter.normal_jerk(time, motion.state, 1e-2 * h)
            v = v + (h**2 - motion.h**2) * self._member.defect * jerk
        return motion._replace(v=v, a=a, h=h)

    def advance(self, time: Array, motion: Motion) -> Motion:
        """The motion one step later, at time = (t, branch).

        Raises
        ------
        NewtonError
            If the step equations cannot be solved.
        """
        s, h, x, c = self._member, self._h, self._x, self._coefficients
        q, v, ddq, a, lam, _ = motion
        n, end = len(q), len(q) + len(lam)
        # Prediction: q'' as before; d is measured from there.
        a_p = (ddq - s.alpha_m * a) / (1.0 - s.alpha_m)
        q_p = q + h * v + h**2 * ((0.5 - s.beta) * a + s.beta * a_p)
        v_p = v + h * ((1.0 - s.gamma) * a + s.gamma * a_p)
        x[:n] = 0.0
        x[end:] = 0.0
        self._newton.aim(c[2], ddq)
        # Under a violent load the accelerations of light, stiff coordinates are huge for an
        # instant: then uniform motion is the better guess.
        self._newton.solve(x, time, q_p, v_p, ddq, q, c, second_guess=q + h * v - q_p)
        return Motion(
            self._newton.position(x, time, q_p, q),
            v_p + c[0] * x[:n],
            ddq + c[1] * x[:n],
            a_p + x[:n] / c[2],
            x[n:end] / c[2],
            h,
        )

    def error(self, before: Motion, after: Motion) -> float:
        """Largest local error of a coordinate over its scale.

        What a step of q lacks is defect h^3 q''', and h q''' is a_{n+1} - a_n:
        e = h^2 (beta + shift/2 - 1/6) (a_{n+1} - a_n). Without shift that is the estimate of
        Zienkiewicz & Xie, Earthq. Eng. Struct. Dyn. 20 (1991) 871; Negrut, Rampalli, Ottarsson &
        Sajdak, J. Comput. Nonlinear Dyn. 2 (2007) 73, have its like for HHT on index 3. Velocities
        lack h^3 q'''' and add as much to positions in the course of time: the period of an
        oscillation is wrong by 1 to 1.4 times (beta + shift/2 - 1/6) (h w)^2. Modes that a step
        passes over are in it with the amplitude they have in q, and rho_inf damps them.
        """
        jump = (after.a - before.a) * self._newton.weights
        return abs(self._member.defect) * self._h**2 * float(np.max(np.abs(jump)))

    @property
    def counts(self) -> Statistics:
        """What it cost."""
        return self._newton.counts

    def _restart(self, h: float, lam: Array) -> None:
        """Set the step, forget the factors, and guess the multipliers."""
        s = self._member
        share = (1.0 - s.alpha_f) / (1.0 - s.alpha_m)
        c_q = h**2 * s.beta
        self._h = h
        self._coefficients = np.array([s.gamma / (h * s.beta), 1.0 / (c_q * share), c_q])
        n = self._newton.coordinates
        self._x[n : n + len(lam)] = c_q * lam
        self._newton.restart()
