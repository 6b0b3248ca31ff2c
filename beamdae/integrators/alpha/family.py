"""The generalized-alpha family: its members, and its start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from beamdae.equations.formulations import State
from beamdae.equations.starts.consistent_start import Starter
from beamdae.integrators.alpha.alpha_workspace import Motion

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
        As h q''' is a_{n+1} - a_n it also estimates the error of a step. Without shift that is the
        estimate of Zienkiewicz & Xie, Earthq. Eng. Struct. Dyn. 20 (1991) 871; Negrut, Rampalli,
        Ottarsson & Sajdak, J. Comput. Nonlinear Dyn. 2 (2007) 73, have its like for HHT on index 3.
        Velocities lack h^3 q'''' and add as much to positions in the course of time: the period of
        an oscillation is wrong by 1 to 1.4 times (beta + shift/2 - 1/6) (h w)^2. Modes that a step
        passes over are in it with the amplitude they have in q, and rho_inf damps them.
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


@dataclass(frozen=True)
class Start:
    """Motions to start from.

    Attributes
    ----------
    member, starter
        The member of the family, and what joints ask of motions.
    index3, cured
        Whether it integrates the index-3 form, and whether starts are cured.
    """

    member: Parameters
    starter: Starter
    index3: bool
    cured: bool

    def started(self, time: Array, state: State, h: float) -> Motion:
        """Motion to start from at time = (t, branch) with the step `h`.

        Of the jerk only what the joints prescribe enters, and modes too stiff for the step respond
        to a load that is there at once as they would after the step: both would ring otherwise.
        """
        q, v, ddq, lam = (x.copy() for x in state)
        if not self.cured:
            return Motion(q, v, ddq, ddq.copy(), lam, h)
        jerk = self.starter.normal_jerk(time, state, 1e-2 * h)
        ddq, _ = self.starter.acceleration(time, state.q, state.v, stiff_time=0.5 * h)
        if self.index3:
            correcting = jerk
            if self.starter.equations.nonholonomic_rows.size:
                # What holds velocities leaves nothing of them to correct.
                correcting = self.starter.normal_jerk(time, state, 1e-2 * h, of_positions=True)
            v += h**2 * self.member.defect * correcting
        return Motion(q, v, ddq, ddq + self.member.shift * h * jerk, lam, h)
