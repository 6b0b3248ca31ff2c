"""What mechanics says of every mechanism, of its equations of motion at one state."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from properties.similarity import ABSOLUTE_ANGLES, Similarity, base_name, transform_values
from support import NumericEquations

import beamdae as bd
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.rank import build_constraint_jacobian

# Of nine-point differences along a motion, over the time in which it changes: they truncate at
# 1e-20 of the ninth derivative, and round at 1e-16 / 3e-3.
DIFFERENCE_STEP = 3e-3
_DIFFERENCE_WEIGHTS = {1: 4.0 / 5.0, 2: -1.0 / 5.0, 3: 4.0 / 105.0, 4: -1.0 / 280.0}


class MechanismState(NumericEquations):
    """A mechanism in its consistent start."""

    def __init__(self, mechanism: bd.Mechanism) -> None:
        super().__init__(mechanism, time=(0.0, 1e-3))
        e = self.equations
        self.q, self.v, self.a, self.lam = ConsistencySolver(e).state(self.time, e.q0, e.v0)

    @property
    def names(self) -> tuple[str, ...]:
        return self.equations.q_names

    @cached_property
    def is_well_posed(self) -> bool:
        """Whether no joint is near to losing rank."""
        e = self.equations
        if not e.m:
            return True
        return bool(
            build_constraint_jacobian(e).smallest_singular_values(self.time[None], self.q[None])[0]
            > 1e-2
        )

    @cached_property
    def held(self) -> np.ndarray:
        """Generalized forces of the joints."""
        return self.reaction(q=self.q, lam=self.lam)

    @cached_property
    def rate(self) -> float:
        """How fast the motion changes [1/s]."""
        scales = self.equations.position_scales
        speed, acceleration = (np.max(np.abs(x) / scales) for x in (self.v, self.a))
        strained = acceleration / speed if speed > 0.0 else 0.0
        return float(max(speed, np.sqrt(acceleration), strained, 1e-6))

    def moving(self, function) -> np.ndarray:
        """Rate of a function of (q, v) along the motion."""
        rate, step = 0.0, DIFFERENCE_STEP / self.rate
        for k, weight in _DIFFERENCE_WEIGHTS.items():
            for d in (k * step, -k * step):
                q, v = self.q + d * self.v + 0.5 * d**2 * self.a, self.v + d * self.a
                rate = rate + np.sign(d) * weight * np.asarray(function(q, v))
        return rate / step

    # Energy -----------------------------------------------------------------------------------

    def powers(self) -> tuple[float, float, np.ndarray]:
        """Rate of the energy, power that is booked, and all terms of both."""
        state = {"q": self.q, "v": self.v, "a": self.a, "lam": self.lam}
        rates = self.moving(lambda q, v: self.energies(q=q, v=v)[:3])
        loads, dissipated = self.energies(**state)[3:]
        terms = np.array([loads, self.driver_power(**state), -dissipated])
        return float(rates.sum()), float(terms.sum()), np.concatenate([rates, terms])

    # Momentum ---------------------------------------------------------------------------------

    def travel(self, q: np.ndarray) -> np.ndarray:
        """Rates of the coordinates as all moves along x, along y, and turns, (n, 3)."""
        found = np.zeros((self.n, 3))
        for k, coordinate in enumerate(self.equations.coordinates):
            own = base_name(coordinate.name)
            if own == "x":
                found[k, 0] = found[k + 1, 1] = 1.0
                found[k, 2], found[k + 1, 2] = -q[k + 1], q[k]
            elif own in ("angle", *ABSOLUTE_ANGLES):
                found[k, 2] = 1.0
        return found

    def momentum(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Linear momentum along x and y, angular momentum about the origin."""
        return self.travel(q).T @ (self.mass(q=q, v=v) @ v)

    def pulls(self, joints: dict[str, str]) -> np.ndarray:
        """Forces and moments about the origin of joints with the ground, by joint, (k, 3).

        On the bodies at their points "a", "b" or "on"; see `observe_ground_reactions`.
        """
        state = {"q": self.q, "v": self.v, "a": self.a, "lam": self.lam}
        found = np.zeros((len(joints), 3))
        for row, name in zip(found, joints, strict=True):
            load = self.observed(f"{name} pull", **state)
            x, y = self.observed(f"{name} place", **state)[:2]
            row[: len(load)] = load
            row[2] += x * load[1] - y * load[0]
        return found

    # Other frames -----------------------------------------------------------------------------

    def rounding(self) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations and reactions that coordinates make of it that are off by their size."""
        e, rng = self.equations, np.random.default_rng(0)
        far = np.abs(self.q) + e.position_scales
        force = np.abs(self.stiffness(q=self.q, v=self.v, a=self.a)) @ far
        force *= rng.choice([-1.0, 1.0], self.n)
        state = State(self.q, self.v, self.a, self.lam)
        a = ConsistencySolver(e).mass_solver(self.time, state)(force)
        return a, force - self.mass(q=self.q) @ a

    def unlike(self, other: MechanismState, frame: Similarity) -> dict[str, float]:
        """Largest relative differences of the same drawing in another frame.

        Of coordinates, rates, accelerations and generalized reactions, each of the largest there
        is; where everything is nearly at rest, or in balance, of a hundredth of what the velocities
        that were asked for make of it, or of what coordinates rounded to 1e-15 do.
        """
        e = other.equations
        asked = e.v0 / e.position_scales
        speed, energy = np.max(np.abs(asked)), other.energies(q=other.q, v=e.v0)[0]
        a, force = other.rounding()
        least = {
            "q": 0.0,
            "v": 1e-2 * speed,
            "a": max(1e-2 * speed**2, 1e-7 * np.max(np.abs(a) / e.position_scales)),
            "Q": max(1e-2 * energy, 1e-7 * np.max(np.abs(force) * e.position_scales)),
        }
        found = {}
        for kind, here, there in (
            ("q", self.q, other.q),
            ("v", self.v, other.v),
            ("a", self.a, other.a),
            ("Q", self.held, other.held),
        ):
            by_name = transform_values(frame, self.equations, here, kind)
            expected = np.array([by_name[name] for name in other.names])
            off = there - expected
            if kind == "q":
                turns = [base_name(name) in ABSOLUTE_ANGLES for name in other.names]
                off[turns] -= 2.0 * np.pi * np.round(off[turns] / (2.0 * np.pi))
            scales = e.position_scales ** (-1 if kind == "Q" else 1)
            size = max(float(np.max(np.abs(expected) / scales)), least[kind], 1e-300)
            found[kind] = float(np.max(np.abs(off) / scales) / size)
        return found


def observe_ground_reactions(mechanism: bd.Mechanism, joints: dict[str, str]) -> bd.Mechanism:
    """Have joints with the ground observed on the body at their point "a", "b" or "on"."""
    for name, which in joints.items():
        joint = mechanism.part(name)
        mechanism.observe(f"{name} pull", joint.reaction_on(which))
        mechanism.observe(f"{name} place", getattr(joint, which))
    return mechanism
