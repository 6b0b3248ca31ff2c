"""Growing modes of the equations linearized about states of a run, and the loads that cause them.

Loads cause the growth of a mode if it vanishes without their derivatives. The growth of modes by
the motion of the mechanism itself, such as the decreasing inertia of a retracted arm, remains.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.analysis.linear_dynamics.linear_model import reduce_to_states
from beamdae.analysis.linear_dynamics.linearization import Linearization, linearize_motion
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.model_checks.load_derivatives import LoadDerivatives, RunState
from beamdae.results.trajectory import Instant

Array = np.ndarray

# Growth rates that remain without the loads that cause a growth, relative to it
_MAX_OPEN_RATIO = 0.5


class Modes(NamedTuple):
    """Growing modes: eigenvalues [1/s], (k,), and motions of the coordinates (n, k)."""

    values: Array
    motions: Array


class LinearizedState:
    """Equations linearized about a state of a run.

    Attributes
    ----------
    lin
        The linearized equations.
    loads
        Derivatives of loads, see `differentiate_loads`.
    """

    def __init__(self, at: RunState, loads: Mapping[str, LoadDerivatives]) -> None:
        self.loads = loads
        if at.equations.redundant:
            instant = Instant(at.time, at.state, None)
            self.lin = linearize_motion(replace(at.equations, configurations=None), instant)
        else:
            tangent = compute_tangent(at.equations, at.time, at.state)
            self.lin = Linearization(at.equations, at.whole, "run", at.time, at.state, tangent)

    @property
    def mass(self) -> sp.csc_array:
        """Mass matrix (n, n)."""
        return self.lin.tangent.mass

    def find_growing(self, min_rate: float, without: Collection[str] = ()) -> Modes:
        """Return the modes that grow faster than a rate [1/s], one of each conjugate pair."""
        tangent = self.lin.tangent
        for name in self.loads.keys() & set(without):
            stiffness, damping = self.loads[name]
            tangent = tangent._replace(
                stiffness=sp.csc_array(tangent.stiffness - stiffness),
                damping=sp.csc_array(tangent.damping - damping),
            )
        model = reduce_to_states(replace(self.lin, tangent=tangent), (), ())
        # Shift and invert: of stiff structures, rounding errors of A reach the slow modes.
        shifted = model.A - min_rate * np.eye(len(model.A))
        inverses, vectors = np.linalg.eig(np.linalg.inv(shifted))
        values = min_rate + 1.0 / inverses
        is_growing = (values.real > min_rate) & (values.imag >= 0.0)
        return Modes(values[is_growing], model._motions @ vectors[:, is_growing])

    def find_cause(self, rate: float) -> str:
        """Return the names of loads without which no vibration grows at half of a rate [1/s]."""
        names = sorted(self.loads)
        for loads in (*([x] for x in names), names):
            values = self.find_growing(_MAX_OPEN_RATIO * rate, loads).values
            if not np.any(values.imag > 0.0):
                return ", ".join(loads)
        return ""
