"""State of a mechanism with energies, momenta and reactions, compared between drawings."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from properties.similarity import ABSOLUTE_ANGLES, Similarity, base_name, transform_values
from support import NumericEquations

import beamdae as bd
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.dependent_constraints import build_constraint_jacobian

# Step of nine-point differences along a motion, relative to its time scale. Truncation errors are
# 1e-20 of the ninth derivative, rounding errors 1e-16 / 3e-3.
DIFFERENCE_STEP = 3e-3
_DIFFERENCE_WEIGHTS = {1: 4.0 / 5.0, 2: -1.0 / 5.0, 3: 4.0 / 105.0, 4: -1.0 / 280.0}


class MechanismState(NumericEquations):
    """Consistent initial state of a mechanism."""

    def __init__(self, mechanism: bd.Mechanism) -> None:
        super().__init__(mechanism, time=(0.0, 1e-3))
        e = self.equations
        self.q, self.v, self.a, self.lam = ConsistencySolver(e).state(self.time, e.q0, e.v0)

    @property
    def names(self) -> tuple[str, ...]:
        return self.equations.q_names

    @cached_property
    def is_well_posed(self) -> bool:
        """True unless the constraint Jacobian is nearly rank deficient."""
        e = self.equations
        if not e.m:
            return True
        return bool(
            build_constraint_jacobian(e).smallest_singular_values(self.time[None], self.q[None])[0]
            > 1e-2
        )

    @cached_property
    def joint_forces(self) -> np.ndarray:
        """Generalized forces of the joints."""
        return self.reaction(q=self.q, lam=self.lam)

    @cached_property
    def rate(self) -> float:
        """Estimated rate of change of the motion [1/s]."""
        scales = self.equations.position_scales
        speed, acceleration = (np.max(np.abs(x) / scales) for x in (self.v, self.a))
        ratio = acceleration / speed if speed > 0.0 else 0.0
        return float(max(speed, np.sqrt(acceleration), ratio, 1e-6))

    def rate_along_motion(self, function) -> np.ndarray:
        """Return the rate of a function of (q, v) along the motion."""
        rate, step = 0.0, DIFFERENCE_STEP / self.rate
        for k, weight in _DIFFERENCE_WEIGHTS.items():
            for d in (k * step, -k * step):
                q, v = self.q + d * self.v + 0.5 * d**2 * self.a, self.v + d * self.a
                rate = rate + np.sign(d) * weight * np.asarray(function(q, v))
        return rate / step

    # Energy -----------------------------------------------------------------------------------

    def powers(self) -> tuple[float, float, np.ndarray]:
        """Return the rate of the energy, the power balance, and all terms of both."""
        state = {"q": self.q, "v": self.v, "a": self.a, "lam": self.lam}
        rates = self.rate_along_motion(lambda q, v: self.energies(q=q, v=v)[:3])
        loads, dissipated = self.energies(**state)[3:]
        terms = np.array([loads, self.driver_power(**state), -dissipated])
        return float(rates.sum()), float(terms.sum()), np.concatenate([rates, terms])

    # Momentum ---------------------------------------------------------------------------------

    def rigid_motions(self, q: np.ndarray) -> np.ndarray:
        """Return the coordinates' rates of rigid motions along x, along y, and about 0, (n, 3)."""
        motions = np.zeros((self.n, 3))
        for k, coordinate in enumerate(self.equations.coordinates):
            kind = base_name(coordinate.name)
            if kind == "x":
                motions[k, 0] = motions[k + 1, 1] = 1.0
                motions[k, 2], motions[k + 1, 2] = -q[k + 1], q[k]
            elif kind in ("angle", *ABSOLUTE_ANGLES):
                motions[k, 2] = 1.0
        return motions

    def momentum(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the linear momentum (x, y) and the angular momentum about the origin."""
        return self.rigid_motions(q).T @ (self.mass(q=q, v=v) @ v)

    def ground_reactions(self, joints: dict[str, str]) -> np.ndarray:
        """Return forces and moments about the origin of joints with the ground, (k, 3).

        They act on the bodies at the attachments "a", "b" or "on"; see `observe_ground_reactions`.
        """
        state = {"q": self.q, "v": self.v, "a": self.a, "lam": self.lam}
        reactions = np.zeros((len(joints), 3))
        for row, name in zip(reactions, joints, strict=True):
            load = self.observed(f"{name} reaction", **state)
            x, y = self.observed(f"{name} position", **state)[:2]
            row[: len(load)] = load
            row[2] += x * load[1] - y * load[0]
        return reactions

    # Similar mechanisms ----------------------------------------------------------------------

    def rounding(self) -> tuple[np.ndarray, np.ndarray]:
        """Return accelerations and reactions due to coordinate errors of natural size."""
        e, rng = self.equations, np.random.default_rng(0)
        size = np.abs(self.q) + e.position_scales
        force = np.abs(self.stiffness(q=self.q, v=self.v, a=self.a)) @ size
        force *= rng.choice([-1.0, 1.0], self.n)
        a, _ = ConsistencySolver(e).solve_saddle(self.time, self.q, self.v, force, 0.0)
        return a, force - self.mass(q=self.q) @ a

    def relative_differences(self, other: MechanismState, frame: Similarity) -> dict[str, float]:
        """Return the largest relative differences from the same drawing in another frame.

        Coordinates "q", rates "v", accelerations "a" and generalized reactions "Q" are relative to
        their largest value. Near rest or balance they are relative to a hundredth of the effect of
        the initial velocities, or to the effect of rounding errors of 1e-15 in the coordinates.
        """
        e = other.equations
        initial = e.v0 / e.position_scales
        speed, energy = np.max(np.abs(initial)), other.energies(q=other.q, v=e.v0)[0]
        a, force = other.rounding()
        smallest_sizes = {
            "q": 0.0,
            "v": 1e-2 * speed,
            "a": max(1e-2 * speed**2, 1e-7 * np.max(np.abs(a) / e.position_scales)),
            "Q": max(1e-2 * energy, 1e-7 * np.max(np.abs(force) * e.position_scales)),
        }
        differences = {}
        for kind, here, there in (
            ("q", self.q, other.q),
            ("v", self.v, other.v),
            ("a", self.a, other.a),
            ("Q", self.joint_forces, other.joint_forces),
        ):
            by_name = transform_values(frame, self.equations, here, kind)
            expected = np.array([by_name[name] for name in other.names])
            error = there - expected
            if kind == "q":
                angles = [base_name(name) in ABSOLUTE_ANGLES for name in other.names]
                error[angles] -= 2.0 * np.pi * np.round(error[angles] / (2.0 * np.pi))
            # The signs of mode shapes are arbitrary.
            modes = [base_name(name) == "mode" for name in other.names]
            error[modes] = np.abs(there[modes]) - np.abs(expected[modes])
            scales = e.position_scales ** (-1 if kind == "Q" else 1)
            size = max(float(np.max(np.abs(expected) / scales)), smallest_sizes[kind], 1e-300)
            differences[kind] = float(np.max(np.abs(error) / scales) / size)
        return differences


def observe_ground_reactions(mechanism: bd.Mechanism, joints: dict[str, str]) -> bd.Mechanism:
    """Observe the reactions of joints with the ground at the attachment "a", "b" or "on"."""
    for name, which in joints.items():
        joint = mechanism.part(name)
        mechanism.observe(f"{name} reaction", joint.reaction_on(which))
        mechanism.observe(f"{name} position", getattr(joint, which))
    return mechanism
