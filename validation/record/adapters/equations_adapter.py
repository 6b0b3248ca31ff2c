"""Adapters of CasADi's IDAS and of SciPy's solve_ivp on exported equations of motion.

The equations of `plain_beams.Model` are exported as CasADi expressions: the mass matrix M, the
forces f(q, v, t) and the constraints g(q, t) = 0. IDAS integrates the semi-explicit system q' = v,
v' = a, M a = f + G^T lam, g'' = 0 of index 1. SciPy integrates the ordinary differential equation
that follows from the solution for a. Neither projects on g = 0; the drift is reported. Static
problems are solved by CasADi's rootfinder.
"""

from __future__ import annotations

import re
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import scipy.sparse as sp
from scipy.integrate import solve_ivp

sys.path.append(str(Path(__file__).resolve().parents[1]))
from geometry import QUANTITIES, law_pieces
from plain_beams import Model

RTOL, ATOL = 1e-6, 1e-8
TIME_LIMIT = 5.0  # processor time of a run [s]
_TRIAL_TIME = 1.0  # processor time [s] after which the time of the whole run is projected
_HOPELESS_RATIO = 10.0  # of the projected time to the limit, from which a run is given up
_PARTS = 20  # of a run of IDAS, between which the time limit is checked
_STATIC_STEPS = 3  # between two rows


def law_expression(law: Any, t: Any) -> Any:
    """Return a time law as an expression in t."""
    *pieces, (_, last) = law_pieces(law, ca)
    result = ca.SX(last(t))
    for end, piece in reversed(pieces):
        result = ca.if_else(t < end, piece(t), result)
    return result


def breakpoints(problem: dict[str, Any]) -> list[float]:
    """Return the times at which a law is not smooth."""
    laws = [x["law"] for key in ("joints", "loads") for x in problem.get(key, []) if "law" in x]
    laws += [law for load in problem.get("loads", []) for law in load.get("components", [])]
    times = {end for law in laws for end, _ in law_pieces(law)}
    return sorted(t for t in times if 0.0 < t < problem["time"]["end"])


def to_casadi(matrix: Any) -> ca.DM:
    """Return a sparse matrix of CasADi."""
    return ca.DM(sp.csc_matrix(matrix))


class Equations:
    """Expressions of the equations of motion in q, v, t, and the factor of a controlled load."""

    def __init__(self, problem: dict[str, Any], elements: int) -> None:
        self.problem, self.model = problem, Model(problem, elements)
        n = self.model.n
        self.q, self.v, self.t = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("t")
        self.factor = ca.SX.sym("factor")
        self.mass = to_casadi(self.model.mass)
        self.points, rates = self._attachments()
        laws = ca.vertcat(*(law_expression(x, self.t) for x in self.model.laws))
        joints = to_casadi(self.model.joint_matrix)
        self.gap = joints @ ca.vec(self.points) - self.model.gap0 - laws
        self.jacobian = ca.jacobian(self.gap, self.q)
        applied = self._applied_forces(rates)
        carried = ca.jtimes(ca.vec(self.points), self.q, ca.vec(applied), True)
        self.force = ca.DM(self.model.weight) - self._internal_force() + carried
        # g'' = G a + (terms without a).
        gap_rate = self.jacobian @ self.v + ca.jacobian(self.gap, self.t)
        self.gap_acceleration = ca.jtimes(gap_rate, self.q, self.v) + ca.jacobian(gap_rate, self.t)

    def _internal_force(self) -> Any:
        model = self.model
        if not len(model._points):
            return ca.SX(model.n, 1)
        operator = to_casadi(model.strain_operator)
        z, rate = (ca.reshape(operator @ x, 4, -1).T for x in (self.q, self.v))
        c, s = ca.cos(model.angles + z[:, 2]), ca.sin(model.angles + z[:, 2])
        axial, shear = c * z[:, 0] + s * z[:, 1], -s * z[:, 0] + c * z[:, 1]
        rates = (
            c * rate[:, 0] + s * rate[:, 1] + shear * rate[:, 2],
            -s * rate[:, 0] + c * rate[:, 1] - axial * rate[:, 2],
            rate[:, 3],
        )
        N, Q, M = (
            model.weights
            * model.stiffness[:, i]
            * (strain - model.strains0[:, i] + model.damping * rates[i])
            for i, strain in enumerate((axial, shear, z[:, 3]))
        )
        parts = ca.horzcat(N * c - Q * s, N * s + Q * c, N * shear - Q * axial, M)
        return operator.T @ ca.vec(parts.T)

    def _attachments(self) -> tuple[Any, Any]:
        """Return P and dP/dt as arrays (3, k)."""
        model, columns, rates = self.model, [], []
        for k, (x, y) in zip(model.nodes, model.arms, strict=True):
            k = int(k)
            c, s = ca.cos(self.q[k + 2]), ca.sin(self.q[k + 2])
            arm = ca.vertcat(c * x - s * y, s * x + c * y)
            spin = self.v[k + 2]
            columns.append(ca.vertcat(self.q[k : k + 2] + arm, self.q[k + 2]))
            turning = spin * ca.vertcat(-arm[1], arm[0])
            rates.append(ca.vertcat(self.v[k : k + 2] + turning, spin))
        return ca.horzcat(*columns), ca.horzcat(*rates)

    def _applied_forces(self, rates: Any) -> Any:
        model, P = self.model, self.points
        F = ca.SX(*P.shape)
        for load, k in model.loads:
            is_controlled = model.control and model.control["load"] == load["name"]
            factor = self.factor if is_controlled else 1.0
            if load["type"] == "moment":
                F[2, k] += factor * law_expression(load["law"], self.t)
                continue
            force = ca.vertcat(*(law_expression(x, self.t) for x in load["components"]))
            if load.get("axes", "inertial") == "body":
                c, s = ca.cos(P[2, k]), ca.sin(P[2, k])
                force = ca.vertcat(c * force[0] - s * force[1], s * force[0] + c * force[1])
            F[:2, k] += factor * force
        for spring, (a, ground_a), (b, ground_b) in model.springs:
            ends = [
                (ca.DM(ground), ca.DM.zeros(2)) if k is None else (P[:2, k], rates[:2, k])
                for k, ground in ((a, ground_a), (b, ground_b))
            ]
            (point_a, rate_a), (point_b, rate_b) = ends
            length = ca.norm_2(point_b - point_a)
            along = (point_b - point_a) / length
            tension = spring["stiffness"] * (length - spring["free_length"])
            tension += spring.get("damping", 0.0) * ca.dot(along, rate_b - rate_a)
            for k, sign in ((a, 1.0), (b, -1.0)):
                if k is not None:
                    F[:2, k] += sign * tension * along
        for contact, k in model.contacts:
            normal = ca.DM(contact["normal"])
            tangent = ca.vertcat(normal[1], -normal[0])
            depth = ca.fmax(-ca.dot(P[:2, k] - ca.DM(contact["a"]["point"]), normal), 0.0)
            opening = ca.dot(rates[:2, k], normal)
            hysteresis = ca.fmax(0.0, 1.0 - contact.get("hysteresis", 0.0) * opening)
            force = contact["stiffness"] * depth ** contact.get("exponent", 1.5) * hysteresis
            slip = ca.dot(rates[:2, k], tangent) / contact.get("friction_speed", 1.0)
            friction = contact.get("friction", 0.0) * ca.tanh(slip)
            F[:2, k] += force * (normal - friction * tangent)
        return F


class TimeLimitError(RuntimeError):
    """The processor time of a run exceeds the limit."""


def check_time(start: float, t: float, end: float) -> None:
    """Raise TimeLimitError if the run has taken too long, or is far from finishing in time."""
    elapsed = time.process_time() - start
    is_hopeless = elapsed > _TRIAL_TIME and elapsed * end > t * _HOPELESS_RATIO * TIME_LIMIT
    if elapsed > TIME_LIMIT or is_hopeless:
        raise TimeLimitError(
            f"stopped at t = {t:.3g} s of {end:g} s after {elapsed:.1f} s of processor time"
        )


def run_idas(equations: Equations, times: np.ndarray, start: float) -> tuple[np.ndarray, int]:
    """Return the coordinates at the times, (rows, n), and the number of steps."""
    e, n, m = equations, equations.model.n, equations.model.m
    a, lam = ca.SX.sym("a", n), ca.SX.sym("lam", m)
    offset, length, tau = ca.SX.sym("offset"), ca.SX.sym("length"), ca.SX.sym("tau")
    balance = e.mass @ a - e.force - e.jacobian.T @ lam
    algebraic = ca.vertcat(balance, e.jacobian @ a + e.gap_acceleration)
    moment = offset + tau * length
    dae = {
        "x": ca.vertcat(e.q, e.v),
        "z": ca.vertcat(a, lam),
        "t": tau,
        "p": ca.vertcat(offset, length),
        "ode": length * ca.vertcat(e.v, a),
        "alg": ca.substitute(algebraic, e.t, moment),
    }
    options = {
        "reltol": RTOL,
        "abstol": ATOL * e.model.size,
        "max_num_steps": 5000,
        "suppress_algebraic": True,
        "calc_ic": False,  # the start is consistent, but the line search fails by rounding
    }
    y = np.concatenate([e.model.q0, e.model.v0])
    saddle = saddle_point(e)
    rows, steps = [e.model.q0], 0
    breaks = [0, len(times) - 1, *np.linspace(0, len(times) - 1, _PARTS + 1).astype(int)]
    breaks += [int(np.argmin(abs(times - x))) for x in breakpoints(e.problem)]
    breaks = sorted(set(breaks))
    for first, last in pairwise(breaks):
        grid = np.linspace(0.0, 1.0, last - first + 1)
        integrator = ca.integrator("run", "idas", dae, 0.0, grid[1:], options)
        matrix, right = saddle(y[:n], y[n:], times[first])
        z = np.linalg.lstsq(np.array(matrix), np.array(right).ravel())[0]
        z[n:] *= -1.0
        interval = [times[first], times[last] - times[first]]
        result = integrator(x0=y, z0=z, p=interval)
        states = np.array(result["xf"]).T
        steps += int(integrator.stats().get("nsteps", 0))
        y = states[-1]
        rows += list(states[:, :n])
        check_time(start, float(times[last]), float(times[-1]))
    return np.array(rows), steps


def saddle_point(equations: Equations) -> Any:
    """Return the function (q, v, t) -> matrix and right-hand side of (a, -lam)."""
    e, m = equations, equations.model.m
    matrix = ca.blockcat([[e.mass, e.jacobian.T], [e.jacobian, ca.SX(m, m)]])
    right = ca.vertcat(e.force, -e.gap_acceleration)
    return ca.Function("saddle", [e.q, e.v, e.t], [ca.densify(matrix), right])


def run_scipy(
    equations: Equations, times: np.ndarray, start: float, method: str
) -> tuple[np.ndarray, int]:
    """Return the coordinates at the times, (rows, n), and the number of steps."""
    model, n = equations.model, equations.model.n
    saddle = saddle_point(equations)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        check_time(start, t, float(times[-1]))
        matrix, right = (np.array(x) for x in saddle(y[:n], y[n:], t))
        try:
            solution = np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError:  # dependent constraints
            solution = np.linalg.lstsq(matrix, right)[0]
        return np.concatenate([y[n:], solution[:n, 0]])

    y, rows, steps = np.concatenate([model.q0, model.v0]), [model.q0], 0
    ends = [0.0, *breakpoints(equations.problem), float(times[-1])]
    for a, b in pairwise(ends):
        inside = np.clip(times[(times > a + 1e-12) & (times <= b + 1e-12)], a, b)
        moments = np.union1d(inside, [b])
        accuracy = {"rtol": RTOL, "atol": ATOL * model.size}
        solution = solve_ivp(rates, (a, b), y, method, moments, **accuracy)
        if not solution.success:
            raise RuntimeError(solution.message)
        rows += list(solution.y[:n, : len(inside)].T)
        y, steps = solution.y[:, -1], steps + solution.njev + solution.nfev
    return np.array(rows), steps


def run_statics(
    equations: Equations, times: np.ndarray, start: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates (rows, n), and the factors of the controlled load."""
    e, model = equations, equations.model
    lam = ca.SX.sym("lam", model.m)
    force = ca.substitute(e.force, e.v, ca.SX.zeros(model.n))
    unknowns, residual = [e.q, lam], [force + e.jacobian.T @ lam, e.gap]
    control = model.control
    if control:
        P = e.points[:, model.controlled]
        value = (
            ca.norm_2(P[:2] - ca.DM(control["from"]))
            if control["quantity"] == "distance"
            else P[QUANTITIES.index(control["quantity"])]
        )
        first = ca.Function("value", [e.q], [value])(model.q0)
        unknowns.append(e.factor)
        residual.append(value - first - law_expression(control["law"], e.t))
    problem = {"x": ca.vertcat(*unknowns), "p": e.t, "g": ca.vertcat(*residual)}
    # The residual of the first iteration exceeds that of the start, so the line search fails.
    options = {"abstolStep": 1e-7, "max_iter": 30, "line_search": False}
    newton = ca.rootfinder("newton", "newton", problem, options)
    y = np.concatenate([model.q0, np.zeros(model.m + bool(control))])
    rows = [y]
    for a, b in pairwise(times):
        for t in np.linspace(a, b, _STATIC_STEPS + 1)[1:]:
            y = np.array(newton(y, t)).ravel()
        check_time(start, float(b), float(times[-1]))
        rows.append(y)
    table = np.array(rows)
    return table[:, : model.n], table[:, -1]


def shorten(message: str) -> str:
    """Return the part of a message of CasADi that names the failure."""
    failure = re.search(r'(\w+ returned "\w+")|rootfinder process failed', message)
    return failure[0] if failure else " ".join(message.split())


def solve(
    problem: dict[str, Any], tool: str, setting: str, elements: int
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return the columns of a problem, and status and cost."""
    clock, processor = time.perf_counter(), time.process_time()
    interval = problem["time"]["output_step"]
    times = np.arange(round(problem["time"]["end"] / interval) + 1) * interval
    factors, information = None, {"success": True, "reason": "reached the end"}
    try:
        equations = Equations(problem, elements)
        model = equations.model
        if problem.get("analysis") == "static":
            if tool == "scipy":
                raise RuntimeError("solve_ivp integrates motions only")
            q, factors = run_statics(equations, times, processor)
        elif tool == "casadi":
            q, information["steps"] = run_idas(equations, times, processor)
        else:
            q, information["steps"] = run_scipy(equations, times, processor, setting)
        table = np.array([model.attachments(x) for x in q])
        columns = {"t [s]": times} | {key: table[:, k] for key, k in model.outputs.items()}
        if factors is not None and model.control:
            columns[f"{model.control['load']}.factor [-]"] = factors
        if model.m:
            drift = max(np.abs(model.gap(x, t)).max() for x, t in zip(q, times, strict=True))
            information["max_position_drift"] = float(drift)
        result = pd.DataFrame(columns)
    except RuntimeError as error:
        result, information = pd.DataFrame(), {"success": False, "reason": shorten(str(error))}
    information["wall_time"] = time.perf_counter() - clock
    information["processor_time"] = time.process_time() - processor
    return result, information
