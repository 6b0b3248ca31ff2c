"""Plain second code: planar geometrically exact beams, joints as constraints, Radau IIA.

It requires numpy and scipy only and was written from these papers:

- E. Reissner, J. Appl. Math. Phys. (ZAMP) 23 (1972) 795; J. C. Simo, L. Vu-Quoc, J. Appl. Mech. 53
  (1986) 849: strains Gamma = R^T r' - R0^T r0', K = theta' - theta0', in absolute coordinates.
- C. W. Gear, B. Leimkuhler, G. K. Gupta, J. Comput. Appl. Math. 12 (1985) 77: constraints at the
  levels of position and velocity (index 2).
- E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), IV.8: Radau IIA of order
  5, with a simplified Newton method in the eigenvectors of the coefficient matrix.

A point z = (x', y', theta, theta') of the axis is a constant sparse operator times the coordinates
q, an attachment P = (x, y, rotation) is a point of a node or of a rigid body, and every joint is
linear in the attachments: g = L P(q) + c(t). Paths of equilibria are followed by Newton's method.
"""

import math
import time
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from geometry import (
    QUANTITIES,
    attached_fractions,
    contact_force,
    law_rate,
    law_value,
    make_curve,
    output_columns,
    rotation,
)
from scipy.sparse.linalg import splu

DEGREE = 4  # of the shape functions; as many Gauss points (reduced quadrature)
_SQRT6 = math.sqrt(6.0)
STAGE_TIMES = np.array([(4.0 - _SQRT6) / 10.0, (4.0 + _SQRT6) / 10.0, 1.0])
# The collocation conditions sum_j A_ij c_j^(k-1) = c_i^k / k determine the coefficients A.
_POWERS = np.vander(STAGE_TIMES, 3, increasing=True)
_A = (STAGE_TIMES[:, None] * _POWERS / [1.0, 2.0, 3.0]) @ np.linalg.inv(_POWERS)
A_INVERSE = np.linalg.inv(_A)
NEWTON_TOLERANCE = 1e-10  # relative to the size of the mechanism
ROUNDING_LIMIT = 1e-8
MAX_ITERATIONS = 15
MAX_HALVINGS = 5  # of a step whose Newton method fails
SLOW_RATE = 0.1  # Newton contraction above which the Jacobian is renewed


def shape_functions(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values and derivatives of the Lagrange polynomials at equidistant nodes."""
    nodes = np.linspace(-1.0, 1.0, DEGREE + 1)
    coefficients = np.linalg.inv(np.vander(nodes))
    derivative = np.vander(xi, DEGREE) * np.arange(DEGREE, 0, -1) @ coefficients[:-1]
    return np.vander(xi, DEGREE + 1) @ coefficients, derivative


class Model:
    """Sparse operators of a mechanism on a mesh of about `elements` elements per beam.

    The coordinates q are x, y and the rotation from the reference configuration, node by node.
    """

    def __init__(self, problem: dict[str, Any], elements: int) -> None:
        self.problem = problem
        q0: list[float] = []
        v0: list[float] = []
        self._q0, self._v0 = q0, v0
        self._mass: list[tuple[int, int, float]] = []
        self._triplets: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._points: list[tuple[float, float, float, np.ndarray]] = []
        self._beam_nodes: dict[str, list[tuple[float, int]]] = {}
        self._centers: dict[str, tuple[Any, int]] = {}
        for body in problem["bodies"]:
            if body["type"] == "beam":
                self._add_beam(body, elements)
            else:
                k = self._add_node(body["center"], body["center"], body.get("initial", {}))
                self._centers[body["name"]] = (np.array(body["center"]), k)
                for offset, value in enumerate((body["mass"], body["mass"], body["inertia"])):
                    self._mass.append((k + offset, k + offset, value))
        for particle in problem.get("point_masses", []):
            k, arm = self._locate(particle["on"])
            if np.any(arm):
                raise ValueError(f"{particle['name']}: attach it to a beam or a center of mass")
            self._mass += [(k + i, k + i, particle["mass"]) for i in range(2)]
        n = self.n = len(q0)
        self.q0, self.v0 = np.array(q0), np.array(v0)
        rows, columns, values = zip(*self._mass, strict=True)
        self.mass = sp.csr_array((values, (rows, columns)), shape=(n, n))
        gravity = np.tile([*problem["gravity"], 0.0], n // 3)
        self.weight = self.mass @ gravity
        self._assemble_strains()
        self._assemble_attachments()
        points = np.r_[self.q0, self.attachments(self.q0)].reshape(-1, 3)[:, :2]
        self.size = float(np.ptp(points, axis=0).max())

    def _add_node(self, point: Any, origin: Any, initial: dict[str, Any]) -> int:
        spin, (vx, vy) = initial.get("angular_velocity", 0.0), initial.get("velocity", (0.0, 0.0))
        k = len(self._q0)
        self._q0 += [float(point[0]), float(point[1]), 0.0]
        self._v0 += [vx - spin * (point[1] - origin[1]), vy + spin * (point[0] - origin[0]), spin]
        return k

    def _add_beam(self, body: dict[str, Any], elements: int) -> None:
        section = self.problem["sections"][body["section"]]
        material = self.problem["materials"][section["material"]]
        area, second_moment = section["area"], section["second_moment"]
        shear_modulus = material["E"] / (2.0 * (1.0 + material["nu"]))
        stiffness = np.array([material["E"], section["shear_coefficient"] * shear_modulus, 0.0])
        stiffness = stiffness * area + [0.0, 0.0, material["E"] * second_moment]
        mass = section.get("mass_per_length", material["rho"] * area)
        inertia = section.get("rotary_inertia_per_length", material["rho"] * second_moment)
        curve, initial = make_curve(body["curve"]), body.get("initial", {})
        # Elements end at the attachments.
        cuts = sorted({0.0, 1.0, *attached_fractions(self.problem, body["name"])})
        ends = [0.0]
        for a, b in pairwise(cuts):
            ends += list(np.linspace(a, b, max(1, math.ceil(elements * (b - a) - 1e-9)) + 1)[1:])
        gauss, gauss_weights = np.polynomial.legendre.leggauss(DEGREE)
        full, full_weights = np.polynomial.legendre.leggauss(DEGREE + 1)
        values, slopes = shape_functions(gauss)
        inertia_values, _ = shape_functions(full)
        nodes: list[tuple[float, int]] = []
        for a, b in pairwise(ends):
            for fraction in np.linspace(a, b, DEGREE + 1)[bool(nodes) :]:
                point = curve.point(fraction * curve.length)
                nodes.append((fraction, self._add_node(point, curve.point(0.0), initial)))
            local = np.array([k for _, k in nodes[-DEGREE - 1 :]])
            jacobian = 0.5 * (b - a) * curve.length
            block = jacobian * (inertia_values.T * full_weights) @ inertia_values
            for (i, j), value in np.ndenumerate(block):
                for offset, density in enumerate((mass, mass, inertia)):
                    self._mass.append((local[i] + offset, local[j] + offset, density * value))
            for w, xi, N, dN in zip(gauss_weights, gauss, values, slopes / jacobian, strict=True):
                columns = np.r_[local, local + 1, local + 2, local + 2]
                rows = 4 * len(self._points) + np.repeat(np.arange(4), DEGREE + 1)
                self._triplets.append((np.r_[dN, dN, N, dN], rows, columns))
                angle = curve.angle((0.5 * (a + b) + 0.5 * (b - a) * xi) * curve.length)
                damping = section.get("damping_time", 0.0)
                self._points.append((angle, w * jacobian, damping, stiffness))
        self._beam_nodes[body["name"]] = nodes

    def _assemble_strains(self) -> None:
        """Build z = strain_operator @ q, four rows (x', y', rotation, rotation') a point."""
        m = len(self._points)
        if not m:
            self.strain_operator = sp.csr_array((0, self.n))
            return
        data, rows, columns = (np.concatenate(part) for part in zip(*self._triplets, strict=True))
        self.strain_operator = sp.csr_array((data, (rows, columns)), shape=(4 * m, self.n))
        self.strain_transposed = sp.csr_array(self.strain_operator.T)
        angles, weights, damping, stiffness = zip(*self._points, strict=True)
        self.angles, self.weights = np.array(angles), np.array(weights)
        self.damping, self.stiffness = np.array(damping), np.array(stiffness)
        # The interpolated reference axis is free of stress.
        self.strains0 = np.zeros((m, 3))
        self.strains0 = self._strains((self.strain_operator @ self.q0).reshape(m, 4))[0]

    def _strains(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the strains (m, 3) and their derivatives by z (m, 3, 4)."""
        c, s = np.cos(self.angles + z[:, 2]), np.sin(self.angles + z[:, 2])
        axial, shear = c * z[:, 0] + s * z[:, 1], -s * z[:, 0] + c * z[:, 1]
        derivative = np.zeros((len(z), 3, 4))
        derivative[:, 0, 0], derivative[:, 0, 1], derivative[:, 0, 2] = c, s, shear
        derivative[:, 1, 0], derivative[:, 1, 1], derivative[:, 1, 2] = -s, c, -axial
        derivative[:, 2, 3] = 1.0
        return np.column_stack([axial, shear, z[:, 3]]) - self.strains0, derivative

    def internal_force(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the elastic and viscous forces."""
        if not len(self._points):
            return np.zeros(self.n)
        strains, derivative = self._strains((self.strain_operator @ q).reshape(-1, 4))
        if self.damping.any():
            rate = (self.strain_operator @ v).reshape(-1, 4, 1)
            strains = strains + self.damping[:, None] * (derivative @ rate)[:, :, 0]
        forces = self.weights[:, None] * self.stiffness * strains
        return self.strain_transposed @ (forces[:, None, :] @ derivative).ravel()

    def internal_tangents(self, q: np.ndarray, v: np.ndarray) -> tuple[Any, Any]:
        """Return the derivatives of `internal_force` by q and by v."""
        m = len(self._points)
        if not m:
            return sp.csr_array((self.n, self.n)), sp.csr_array((self.n, self.n))
        z, rate = ((self.strain_operator @ x).reshape(-1, 4) for x in (q, v))
        strains, B = self._strains(z)
        viscous = self.damping[:, None] * np.einsum("mij,mj->mi", B, rate)
        S = self.weights[:, None] * self.stiffness * (strains + viscous)
        second = np.zeros((m, 3, 4, 4))  # of the strains by z
        c, s = B[:, 0, 0], B[:, 0, 1]
        second[:, 0, 0, 2] = second[:, 0, 2, 0] = -s
        second[:, 0, 1, 2] = second[:, 0, 2, 1] = c
        second[:, 1, 0, 2] = second[:, 1, 2, 0] = -c
        second[:, 1, 1, 2] = second[:, 1, 2, 1] = -s
        second[:, 0, 2, 2], second[:, 1, 2, 2] = B[:, 1, 2], -B[:, 0, 2]
        D = self.weights[:, None] * self.stiffness
        by_rate = np.einsum("mij,mi,mik->mjk", B, D * self.damping[:, None], B)
        rate_by_z = np.einsum("mikl,ml->mik", second, rate)
        by_z = np.einsum("mij,mi,mik->mjk", B, D, B) + np.einsum("mi,mijk->mjk", S, second)
        by_z += np.einsum("mij,mi,mik->mjk", B, D * self.damping[:, None], rate_by_z)

        def assemble(blocks: np.ndarray) -> Any:
            indices = np.arange(m), np.arange(m + 1)
            matrix = sp.bsr_array((blocks, *indices), shape=(4 * m, 4 * m))
            return self.strain_transposed @ sp.csr_array(matrix) @ self.strain_operator

        return assemble(by_z), assemble(by_rate)

    def _locate(self, attachment: dict[str, Any]) -> tuple[int, np.ndarray]:
        """Return the first coordinate of the node, and the arm in the reference configuration."""
        name = attachment["body"]
        if name in self._centers:
            center, k = self._centers[name]
            return k, np.array(attachment["point"]) - center
        fraction = attachment["fraction"]
        return min(self._beam_nodes[name], key=lambda x: abs(x[0] - fraction))[1], np.zeros(2)

    def _assemble_attachments(self) -> None:
        """Number the attachments and build g = joint_matrix @ P + joint_laws(t)."""
        problem = self.problem
        self._nodes: list[int] = []
        self._arms: list[np.ndarray] = []
        first = {output["name"]: 3 * self._attach(output["on"]) for output in problem["outputs"]}
        # Row of P by column of the results.
        self.outputs = {
            header: first[output["name"]] + QUANTITIES.index(quantity)
            for header, output, quantity in output_columns(problem)
        }
        self.loads = [(load, self._attach(load["on"])) for load in problem.get("loads", [])]
        self.springs = []
        for spring in problem.get("springs", []):
            ends = [self._attach_end(spring[key]) for key in "ab"]
            self.springs.append((spring, *ends))
        self.contacts = [(x, self._attach(x["b"])) for x in problem.get("contacts", [])]
        self.has_forces = bool(self.loads or self.springs or self.contacts)
        # The controlled load of a static problem, times its factor.
        self.control, self.factor = problem.get("control"), 1.0
        self.controlled = self._attach(self.control["on"]) if self.control else 0
        rows: list[tuple[dict[int, float], Any]] = []
        for joint in problem["joints"]:
            (a, _), (b, _) = (self._attach_end(joint[key]) for key in "ab")
            if joint["type"] == "point_on_line":
                if a is not None:
                    raise ValueError(f"{joint['name']}: the line must belong to the ground")
                dx, dy = np.array(joint["direction"]) / np.hypot(*joint["direction"])
                rows.append(({3 * b: -dy, 3 * b + 1: dx}, 0.0))
                continue
            kinds = {"revolute": (0, 1), "weld": (0, 1, 2), "driver": (2,)}[joint["type"]]
            for i in kinds:
                row = {} if a is None else {3 * a + i: -1.0}
                row |= {} if b is None else {3 * b + i: 1.0}
                rows.append((row, joint.get("law", 0.0)))
        self.nodes, self.arms = np.array(self._nodes), np.array(self._arms)
        m = self.m = len(rows)
        entries = [(i, j, x) for i, (row, _) in enumerate(rows) for j, x in row.items()]
        index, columns, values = zip(*entries, strict=True) if entries else ((), (), ())
        shape = (m, 3 * len(self.nodes))
        self.joint_matrix = np.zeros(shape)
        self.joint_matrix[list(index), list(columns)] = values
        self.laws = [law for _, law in rows]
        self.gap0 = self.joint_matrix @ self.attachments(self.q0)

    def _attach(self, attachment: dict[str, Any]) -> int:
        k, arm = self._locate(attachment)
        self._nodes.append(k)
        self._arms.append(arm)
        return len(self._nodes) - 1

    def _attach_end(self, attachment: dict[str, Any]) -> tuple[int | None, np.ndarray]:
        if attachment["body"] == "ground":
            return None, np.array(attachment["point"])
        return self._attach(attachment), np.zeros(2)

    def _arms_at(self, q: np.ndarray) -> np.ndarray:
        c, s = np.cos(q[self.nodes + 2]), np.sin(q[self.nodes + 2])
        x, y = self.arms.T
        return np.column_stack([c * x - s * y, s * x + c * y])

    def attachments(self, q: np.ndarray) -> np.ndarray:
        """Return P = (x, y, rotation) of all attachments in one vector."""
        P = q[self.nodes[:, None] + np.arange(3)]
        P[:, :2] += self._arms_at(q)
        return P.ravel()

    def attachment_rates(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return dP/dt."""
        rates, arms = v[self.nodes[:, None] + np.arange(3)], self._arms_at(q)
        rates[:, 0] -= arms[:, 1] * rates[:, 2]
        rates[:, 1] += arms[:, 0] * rates[:, 2]
        return rates.ravel()

    def carry(self, q: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Return (dP/dq)^T forces."""
        forces, arms = forces.reshape(-1, 3), self._arms_at(q)
        moments = forces[:, 2] + arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0]
        total = np.zeros(self.n)
        np.add.at(total, self.nodes, forces[:, 0])
        np.add.at(total, self.nodes + 1, forces[:, 1])
        np.add.at(total, self.nodes + 2, moments)
        return total

    def attachment_matrix(self, q: np.ndarray) -> Any:
        """Return dP/dq."""
        count, arms = len(self.nodes), self._arms_at(q)
        first, k = 3 * np.arange(count), self.nodes
        rows = np.r_[first, first + 1, first + 2, first, first + 1]
        columns = np.r_[k, k + 1, k + 2, k + 2, k + 2]
        values = np.r_[np.ones(3 * count), -arms[:, 1], arms[:, 0]]
        return sp.csr_array((values, (rows, columns)), shape=(3 * count, self.n))

    def attachment_forces(self, P: np.ndarray, rates: np.ndarray, t: float) -> np.ndarray:
        """Return the loads and the forces of springs, conjugate to P."""
        F, P, rates = np.zeros((len(self.nodes), 3)), P.reshape(-1, 3), rates.reshape(-1, 3)
        for load, k in self.loads:
            factor = self.factor if self.control and self.control["load"] == load["name"] else 1.0
            if load["type"] == "moment":
                F[k, 2] += factor * law_value(load["law"], t)
                continue
            force = factor * np.array([law_value(law, t) for law in load["components"]])
            if load.get("axes", "inertial") == "body":
                force = rotation(P[k, 2]) @ force
            F[k, :2] += force
        for spring, (a, ground_a), (b, ground_b) in self.springs:
            point_a, rate_a = (ground_a, np.zeros(2)) if a is None else (P[a, :2], rates[a, :2])
            point_b, rate_b = (ground_b, np.zeros(2)) if b is None else (P[b, :2], rates[b, :2])
            length = np.hypot(*(point_b - point_a))
            along = (point_b - point_a) / length
            tension = spring["stiffness"] * (length - spring["free_length"])
            tension += spring.get("damping", 0.0) * along @ (rate_b - rate_a)
            for k, sign in ((a, 1.0), (b, -1.0)):
                if k is not None:
                    F[k, :2] += sign * tension * along
        for contact, k in self.contacts:
            F[k, :2] += contact_force(contact, P[k, :2], rates[k, :2])
        return F.ravel()

    def forces(self, q: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """Return weight, loads and springs less the internal forces."""
        total = self.weight - self.internal_force(q, v)
        if self.has_forces:
            P, rates = self.attachments(q), self.attachment_rates(q, v)
            total = total + self.carry(q, self.attachment_forces(P, rates, t))
        return total

    def gap(self, q: np.ndarray, t: float) -> np.ndarray:
        """Return the constraints at the level of positions."""
        laws = np.array([law_value(law, t) for law in self.laws])
        return self.joint_matrix @ self.attachments(q) - self.gap0 - laws

    def gap_rate(self, q: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
        """Return the constraints at the level of velocities."""
        rates = np.array([law_rate(law, t) for law in self.laws])
        return self.joint_matrix @ self.attachment_rates(q, v) - rates

    def force_tangents(self, q: np.ndarray, v: np.ndarray, t: float, lam: np.ndarray) -> Any:
        """Return d(forces + G^T lam)/dq and d(forces)/dv."""
        by_q, by_v = self.internal_tangents(q, v)
        matrix, P = self.attachment_matrix(q), self.attachments(q)
        rates, count = matrix @ v, len(P)
        base = self.attachment_forces(P, rates, t)
        applied, viscous = np.zeros((count, count)), np.zeros((count, count))
        if self.has_forces:  # differences: few attachments, and Newton corrects
            step = 1e-7 * self.size
            for i in range(count):
                unit = np.eye(count)[i] * step
                applied[:, i] = (self.attachment_forces(P + unit, rates, t) - base) / step
                viscous[:, i] = (self.attachment_forces(P, rates + unit, t) - base) / step
        carried = (base + self.joint_matrix.T @ lam).reshape(-1, 3)
        turning = -np.einsum("ij,ij->i", self._arms_at(q), carried[:, :2])
        k = self.nodes + 2
        geometric = sp.csr_array((turning, (k, k)), shape=(self.n, self.n))
        applied, viscous = sp.csr_array(applied), sp.csr_array(viscous)
        return (
            matrix.T @ applied @ matrix + geometric - by_q,
            matrix.T @ viscous @ matrix - by_v,
        )


def controlled_value(control: dict[str, Any], P: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the controlled quantity of P = (x, y, rotation), and its derivatives by P."""
    if control["quantity"] == "distance":
        arm = P[:2] - control["from"]
        distance = float(np.hypot(*arm))
        return distance, np.r_[arm / distance, 0.0]
    k = QUANTITIES.index(control["quantity"])
    return float(P[k]), np.eye(3)[k]


class NewtonError(RuntimeError):
    """Newton's method has not converged."""


class RadauIIA:
    """Fixed steps of order 5 for M q' = M v + G^T mu, M v' = f + G^T lam, g = 0, g' = 0."""

    def __init__(self, model: Model, step: float) -> None:
        self.model, self.h = model, step
        values, self.vectors = np.linalg.eig(A_INVERSE)
        # One real eigenvalue and one of the conjugate pair.
        self.picked = [int(np.argmin(abs(values.imag))), int(np.argmax(values.imag))]
        # The eigenvector of the real eigenvalue is real up to a factor.
        phase = self.vectors[np.argmax(abs(self.vectors[:, self.picked[0]])), self.picked[0]]
        self.vectors[:, self.picked[0]] /= phase
        self.inverse = np.linalg.inv(self.vectors)
        self.sigma = values[self.picked] / step
        self.factors: list[Any] = []
        n, m = model.n, model.m
        self.parts = np.cumsum([n, n, m])
        self.differential = sp.block_diag([model.mass, model.mass]).tocsr()
        self.statistics = {"steps": 0, "iterations": 0, "factorizations": 0}

    def factorize(self, y: np.ndarray, t: float) -> None:
        """Factorize the Newton matrices of the eigenvalues at the state y."""
        model = self.model
        q, v, _, lam = np.split(y, self.parts)
        joints = sp.csr_array(model.joint_matrix)
        G = joints @ model.attachment_matrix(q)
        step = 1e-7 * model.size / max(np.abs(v).max(), 1e-300)
        G_ahead = joints @ model.attachment_matrix(q + step * v)
        by_q, by_v = model.force_tangents(q, v, t, lam)
        M, G_rate, zero = model.mass, (G_ahead - G) / step, None
        self.factors = []
        for sigma in self.sigma:
            if abs(sigma.imag) < 1e-12 * abs(sigma):
                sigma = sigma.real
            blocks = [
                [sigma * M, -M, -G.T, zero],
                [-by_q, sigma * M - by_v, zero, -G.T],
                [G, zero, zero, zero],
                [G_rate, G, zero, zero],
            ]
            if not model.m:
                blocks = [row[:2] for row in blocks[:2]]
            self.factors.append(splu(sp.csc_array(sp.block_array(blocks)), permc_spec="COLAMD"))
        self.statistics["factorizations"] += 1

    def residual(self, y: np.ndarray, t: float) -> np.ndarray:
        """Return the right-hand side and the constraints at one stage."""
        model = self.model
        q, v, mu, lam = np.split(y, self.parts)
        rates, forces = model.mass @ v, model.forces(q, v, t)
        if model.m:
            rates = rates + model.carry(q, model.joint_matrix.T @ mu)
            forces = forces + model.carry(q, model.joint_matrix.T @ lam)
        return np.concatenate([rates, forces, -model.gap(q, t), -model.gap_rate(q, v, t)])

    def step(self, y: np.ndarray, t: float, guess: np.ndarray) -> np.ndarray:
        """Return the three stages of the step from (t, y); `guess` is the first guess."""
        fresh = not self.factors
        if fresh:
            self.factorize(guess[1], t + STAGE_TIMES[1] * self.h)
        for stages in (guess.copy(), guess.copy(), np.tile(y, (3, 1))):
            previous = math.inf
            for iteration in range(MAX_ITERATIONS):
                update = self.newton_update(y, t, stages)
                stages += update
                n = self.model.n
                length = max(
                    np.abs(update[:, :n]).max(), self.h * np.abs(update[:, n:][:, :n]).max()
                )
                size = length / self.model.size
                rate, previous = size / max(previous, 1e-300), size
                # Below the limit of rounding, the updates no longer decrease.
                if size < NEWTON_TOLERANCE or (size < ROUNDING_LIMIT and rate > 0.5):
                    if rate > SLOW_RATE and not fresh:
                        self.factors = []
                    return stages
                too_slow = iteration > 3 and rate > 0.5
                if too_slow or rate > 2.0 or not math.isfinite(size):
                    break
            converging = math.isfinite(size) and size < 1e-2
            self.factorize(stages[1] if converging else y, t + STAGE_TIMES[1] * self.h)
            fresh = True
        raise NewtonError(f"Newton's method failed at t = {t:g} s (last update {size:.1e})")

    def newton_update(self, y: np.ndarray, t: float, stages: np.ndarray) -> np.ndarray:
        """Return the update of the stages by the simplified Newton method."""
        differential = slice(0, 2 * self.model.n)
        right = np.array([
            self.residual(stage, t + c * self.h)
            for stage, c in zip(stages, STAGE_TIMES, strict=True)
        ])  # fmt: skip
        self.statistics["iterations"] += 1
        rates = A_INVERSE @ (stages - y)[:, differential] / self.h
        right[:, differential] -= rates @ self.differential.T
        transformed = self.inverse @ right
        real, pair = self.picked
        part = self.factors[0].solve(transformed[real].real.copy())
        update = np.outer(self.vectors[:, real].real, part)
        part = self.factors[1].solve(transformed[pair])
        return update + 2.0 * np.outer(self.vectors[:, pair], part).real


class Motion:
    """Motion y = (q, v, mu, lam) with fixed steps from a consistent start."""

    def __init__(self, model: Model, step: float) -> None:
        self.model, self.radau = model, RadauIIA(model, step)
        self.statistics = self.radau.statistics
        self.start = np.concatenate([model.q0, model.v0, np.zeros(2 * model.m)])
        self.guess = np.tile(self.start, (3, 1))
        # The collocation polynomial through y and the stages, continued to the next step.
        nodes = np.r_[0.0, STAGE_TIMES]
        self.continuation = np.vander(1.0 + STAGE_TIMES, 4) @ np.linalg.inv(np.vander(nodes))

    def advance(self, y: np.ndarray, t: float) -> np.ndarray:
        """Return the state after a step from (t, y)."""
        stages = self.stages(y, t)
        self.guess = self.continuation @ np.vstack([y, stages])
        # Multipliers of the first guess are those of the last stage.
        self.guess[:, 2 * self.model.n :] = stages[-1, 2 * self.model.n :]
        return stages[-1]

    def stages(self, y: np.ndarray, t: float) -> Any:
        """Return the stages of a step, or of the last of 2, 4, ... steps if Newton fails."""
        for halvings in range(MAX_HALVINGS + 1):
            part = RadauIIA(self.model, self.radau.h / 2**halvings) if halvings else self.radau
            stages, state = np.tile(y, (3, 1)) if halvings else self.guess, y
            try:
                for k in range(2**halvings):
                    stages = part.step(state, t + k * part.h, stages)
                    state = stages[-1]
                    self.statistics["steps"] += 1
                    if halvings:
                        stages = np.tile(state, (3, 1))
                return stages
            except NewtonError:
                if halvings == MAX_HALVINGS:
                    raise
            finally:
                if halvings:
                    for key in ("iterations", "factorizations"):
                        self.statistics[key] += part.statistics[key]


class StaticPath:
    """Path of equilibria y = (q, lam, factor of the controlled load) with the parameter t."""

    def __init__(self, model: Model, step: float) -> None:
        self.model, self.step = model, step
        self.statistics = {"steps": 0, "iterations": 0}
        self.at_rest = np.zeros(model.n)
        self.rows = slice(3 * model.controlled, 3 * model.controlled + 3)
        if model.control:
            P = model.attachments(model.q0)[self.rows]
            self.start_value, _ = controlled_value(model.control, P)
        zeros = np.zeros(model.m + bool(model.control))
        self.start = self.equilibrium(np.concatenate([model.q0, zeros]), 0.0)

    def equilibrium(self, guess: np.ndarray, t: float) -> np.ndarray:
        """Return the equilibrium at t by Newton's method."""
        model, y, previous = self.model, guess.copy(), math.inf
        n, m = model.n, model.m
        for _ in range(MAX_ITERATIONS):
            self.statistics["iterations"] += 1
            q, lam = y[:n], y[n : n + m]
            model.factor = y[n + m] if model.control else 1.0
            matrix = model.attachment_matrix(q)
            G = sp.csr_array(model.joint_matrix) @ matrix
            stiffness, _ = model.force_tangents(q, self.at_rest, t, lam)
            force = model.forces(q, self.at_rest, t)
            residual = [force + G.T @ lam, model.gap(q, t)]
            blocks = [[stiffness, G.T], [G, None]]
            if model.control:
                P = model.attachments(q)[self.rows]
                value, slope = controlled_value(model.control, P)
                target = self.start_value + law_value(model.control["law"], t)
                residual.append(np.array([value - target]))
                row = sp.csr_array(slope[None, :]) @ matrix[self.rows]
                model.factor += 1.0
                column = sp.csr_array((model.forces(q, self.at_rest, t) - force)[:, None])
                blocks = [[stiffness, G.T, column], [G, None, None], [row, None, None]]
            if not m:
                blocks = [[x for j, x in enumerate(b) if j != 1] for b in blocks[:1] + blocks[2:]]
            tangent = sp.csc_array(sp.block_array(blocks))
            update = -splu(tangent).solve(np.concatenate(residual))
            y += update
            size = float(np.abs(update[:n]).max()) / model.size
            rate, previous = size / max(previous, 1e-300), size
            if size < NEWTON_TOLERANCE or (size < ROUNDING_LIMIT and rate > 0.5):
                return y
            if not size < 1.0:
                break
        raise NewtonError(f"Newton's method failed at t = {t:g} (last update {previous:.1e})")

    def advance(self, y: np.ndarray, t: float) -> np.ndarray:
        """Return the equilibrium a step after t."""
        self.statistics["steps"] += 1
        return self._advance(y, t, self.step)

    def _advance(self, y: np.ndarray, t: float, step: float, depth: int = 0) -> np.ndarray:
        """Return the equilibrium at t + step; halve the step if Newton's method fails."""
        try:
            return self.equilibrium(y, t + step)
        except NewtonError:
            if depth == MAX_HALVINGS:
                raise
            middle = self._advance(y, t, 0.5 * step, depth + 1)
            return self._advance(middle, t + 0.5 * step, 0.5 * step, depth + 1)


def solve(problem: dict[str, Any], elements: int = 8, substeps: int = 4) -> dict[str, Any]:
    """Return columns and statistics of a problem, with `substeps` steps between two rows."""
    clock, processor = time.perf_counter(), time.process_time()
    model, interval = Model(problem, elements), problem["time"]["output_step"]
    kind = StaticPath if problem.get("analysis") == "static" else Motion
    path = kind(model, interval / substeps)
    y, times = path.start, np.arange(round(problem["time"]["end"] / interval) + 1) * interval
    states, drift = [y], 0.0
    for i, end in enumerate(times[1:]):
        for j in range(substeps):
            y = path.advance(y, (i + j / substeps) * interval)
        states.append(y)
        if model.m:
            drift = max(drift, float(np.abs(model.gap(y[: model.n], end)).max()))
    table = np.array([model.attachments(y[: model.n]) for y in states])
    columns = {"t [s]": times} | {name: table[:, row] for name, row in model.outputs.items()}
    if model.control:
        columns[f"{model.control['load']}.factor [-]"] = np.array(states)[:, -1]
    statistics = path.statistics | {
        "max_position_drift": drift,
        "wall_time": time.perf_counter() - clock,
        "processor_time": time.process_time() - processor,
    }
    return {"columns": columns, "statistics": statistics}
