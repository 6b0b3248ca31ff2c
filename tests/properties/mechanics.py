"""What mechanics says of every mechanism, of its equations of motion at one state."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from support import Numeric

import beamdae as bd
from beamdae.equations.consistent_start import Starter
from beamdae.equations.rank import joint_matrix

# Of nine-point differences along a motion, over the time in which it changes: they truncate at
# 1e-20 of the ninth derivative, and round at 1e-16 / 3e-3.
STEP = 3e-3
_NODES = {1: 4.0 / 5.0, 2: -1.0 / 5.0, 3: 4.0 / 105.0, 4: -1.0 / 280.0}


class State(Numeric):
    """A mechanism in its consistent start, or beside the drawing by `aside` of its size."""

    def __init__(self, mechanism: bd.Mechanism, aside: float = 0.0, seed: int = 0) -> None:
        super().__init__(mechanism, time=(0.0, 1e-3))
        e = self.equations
        way = aside * np.random.default_rng(seed).standard_normal(e.n) * e.position_scales
        found = Starter(e).state(self.time, e.q0 + way, e.v0)
        self.q, self.v, self.a, self.lam = found

    @property
    def names(self) -> tuple[str, ...]:
        return self.equations.q_names

    @cached_property
    def is_well_posed(self) -> bool:
        """Whether no joint is near to losing rank."""
        e = self.equations
        if not e.m:
            return True
        return bool(joint_matrix(e).smallest(self.time[None], self.q[None])[0] > 1e-2)

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
        rate, step = 0.0, STEP / self.rate
        for k, weight in _NODES.items():
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
            own = coordinate.name.rpartition(".")[2]
            if own in ("x", "x0"):
                found[k, 0] = found[k + 1, 1] = 1.0
                found[k, 2], found[k + 1, 2] = -q[k + 1], q[k]
            elif own in ("angle", "theta"):
                found[k, 2] = 1.0
        return found

    def momentum(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Linear momentum along x and y, angular momentum about the origin."""
        return self.travel(q).T @ (self.mass(q=q, v=v) @ v)

    def pulls(self) -> np.ndarray:
        """Forces and moment about the origin of the ground on what is joined to it, by joint."""
        found = [np.zeros(3)]
        for name in self.ground_joints:
            for which in "ab":
                try:
                    x, y, fx, fy, m = self._pull(name, which)
                except KeyError:
                    continue
                found.append(np.array([fx, fy, m + x * fy - y * fx]))
        return np.array(found)

    @property
    def ground_joints(self) -> list[str]:
        return [o.name[:-2] for o in self.equations.observables if o.name.endswith(" a")] + [
            o.name[:-2] for o in self.equations.observables if o.name.endswith(" b")
        ]

    def _pull(self, name: str, which: str):
        state = {"q": self.q, "v": self.v, "a": self.a, "lam": self.lam}
        load = self.observed(f"{name} {which}", **state)
        x, y = self.observed(f"{name} {which} at", **state)[:2]
        return x, y, *load, *([0.0] * (3 - len(load)))


def compared(state: State, other: dict[str, np.ndarray], values: np.ndarray, size: float) -> float:
    """Largest difference to what another mechanism has by name, over the size."""
    expected = np.array([other[name] for name in state.names])
    scales = state.equations.position_scales
    return float(np.max(np.abs(values - expected) / scales) / size)
