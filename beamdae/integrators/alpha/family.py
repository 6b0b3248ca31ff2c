"""Parameters and starting values of the generalized-alpha, HHT and Newmark methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver

Array = np.ndarray

FAMILIES = ("generalized-alpha", "hht", "newmark")

# Interval of the finite difference of accelerations for the jerk, relative to the step.
JERK_INTERVAL = 1e-2
# `stiff_time` of the initial accelerations, relative to the step: the start ignores vibrations
# that the step does not resolve.
STIFF_TIME = 0.5


class AlphaParameters(NamedTuple):
    """Parameters of one member of the generalized-alpha family.

    (1 - alpha_m) a_{n+1} + alpha_m a_n = (1 - alpha_f) q''_{n+1} + alpha_f q''_n,
    q_{n+1} = q_n + h v_n + h^2 ((1/2 - beta) a_n + beta a_{n+1}),
    v_{n+1} = v_n + h ((1 - gamma) a_n + gamma a_{n+1}).

    a_n approximates q'' at t_n + `shift` h with an error of order h^2. The first formula then
    requires shift = alpha_m - alpha_f. Where constraints prescribe q, the third formula requires
    shift = 1/2 - gamma. Both values agree for second-order members; `shift` is 1/2 - gamma.
    """

    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    shift: float

    def coefficients(self, h: Any) -> tuple[Any, Any, Any]:
        """Return the factors (c_v, c_a, c_f) of `StepEquations` for a step or steps `h` [s]."""
        c_f = h * h * self.beta
        c_a = (1.0 - self.alpha_m) / ((1.0 - self.alpha_f) * c_f)
        return self.gamma / (h * self.beta), c_a, c_f

    @property
    def defect(self) -> float:
        """Local error of q divided by h^3 q''': 1/6 - shift/2 - beta.

        The value follows from a_n = q'' + shift h q''' and a_{n+1} = q'' + (1 + shift) h q''' in
        the second formula. Because a_{n+1} - a_n approximates h q''', the error of a step is
        estimated by this value times h^2 (a_{n+1} - a_n). For shift = 0, this is the estimate of
        Zienkiewicz & Xie, Earthq. Eng. Struct. Dyn. 20 (1991) 871, which Negrut, Rampalli,
        Ottarsson & Sajdak, J. Comput. Nonlinear Dyn. 2 (2007) 73, use for HHT in the index-3 form.
        Over time, the error h^3 q'''' of the velocities causes position errors of similar size:
        the relative error of the period of an oscillation with angular frequency w is 1 to 1.4
        times (beta + shift/2 - 1/6) (h w)^2. Unresolved modes contribute to the estimate with their
        amplitudes in q; they are damped if rho_inf < 1.
        """
        return 1.0 / 6.0 - 0.5 * self.shift - self.beta


def family_parameters(family: str, rho_inf: float) -> AlphaParameters:
    """Return the parameters of a family for the spectral radius `rho_inf` at infinite frequency.

    All three families have gamma = (3 - rho_inf) / (2 (1 + rho_inf)) and
    beta = (gamma + 1/2)^2 / 4. They differ in alpha_m and alpha_f:

    =================  ===============================  =============================  ===========
    family             alpha_m                          alpha_f                        order
    =================  ===============================  =============================  ===========
    generalized-alpha  (2 rho_inf - 1) / (rho_inf + 1)  rho_inf / (rho_inf + 1)        2
    hht                0                                (1 - rho_inf) / (1 + rho_inf)  2
    newmark            0                                0                              1
    =================  ===============================  =============================  ===========

    With rho_inf = 1, "newmark" is the trapezoidal rule, of order 2. "hht" has a second eigenvalue
    of magnitude alpha_f / (1 - alpha_f) at infinite frequency, which exceeds rho_inf if
    rho_inf < 1/2.

    Chung & Hulbert, J. Appl. Mech. 60 (1993) 371; Hilber, Hughes & Taylor, Earthq. Eng. Struct.
    Dyn. 5 (1977) 283; Newmark, J. Eng. Mech. Div. ASCE 85 (1959) 67.
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
    return AlphaParameters(alpha_m, alpha_f, gamma, beta, shift)


@dataclass(slots=True)
class Motion:
    """State after a step of length `h` [s].

    `ddq` is the true acceleration q'', `a` the algorithmic acceleration.
    """

    q: Array
    v: Array
    ddq: Array
    a: Array
    lam: Array
    h: float = 0.0


@dataclass(frozen=True)
class AlphaStart:
    """Starting values of the generalized-alpha family.

    Attributes
    ----------
    member
        Parameters of the method.
    solver
        Solver for consistent accelerations and the normal jerk.
    index3
        True for the index-3 form, False for the stabilized index-2 form.
    cured
        True to correct the starting values so that multipliers are second-order accurate; see
        `GeneralizedAlpha`.
    """

    member: AlphaParameters
    solver: ConsistencySolver
    index3: bool
    cured: bool

    def initial_motion(self, time: Array, state: State, h: float) -> Motion:
        """Return the starting values at `time` = (t, branch) for steps `h` [s].

        To avoid spurious oscillations, the corrections use only the jerk that the constraints
        prescribe, and accelerations of modes that are too fast for the step are reduced.
        """
        q, v, ddq, lam = (x.copy() for x in state)
        if not self.cured:
            return Motion(q, v, ddq, ddq.copy(), lam, h)
        interval = JERK_INTERVAL * h
        jerk = self.solver.evaluate_normal_jerk(time, state, interval)
        stiff_time = STIFF_TIME * h
        ddq, _ = self.solver.acceleration(time, state.q, state.v, stiff_time=stiff_time)
        if self.index3:
            position_jerk = jerk
            if self.solver.equations.nonholonomic_rows.size:
                # Velocities prescribed by nonholonomic constraints need no correction.
                position_jerk = self.solver.evaluate_normal_jerk(
                    time, state, interval, holonomic_only=True
                )
            v += h**2 * self.member.defect * position_jerk
        return Motion(q, v, ddq, ddq + self.member.shift * h * jerk, lam, h)
