"""Properties of random mechanisms in equilibrium."""

from random import Random

import numpy as np
from hypothesis import assume
from properties.drawings import Drawing
from properties.mechanism_state import MechanismState
from properties.similarity import Similarity
from properties.state_laws import consistent_state, similarity_transformations

import beamdae as bd

# Parts of the errors about mechanisms without a unique equilibrium.
NO_EQUILIBRIUM = ("no equilibrium was found", "acts on velocities only")


class EquilibriumState(MechanismState):
    """Equilibrium of a mechanism under all loads, as a state without velocities."""

    def __init__(self, mechanism: bd.Mechanism) -> None:
        super().__init__(mechanism)
        self.path = bd.equilibrium(self.equations)
        self.time = np.zeros(2)
        self.q, self.lam = self.path.q[-1], self.path.lam[-1]
        self.v = self.a = np.zeros(self.n)


def find_equilibrium_state(drawing: Drawing) -> EquilibriumState:
    """Return the equilibrium; reject the example unless it is stable and isolated."""
    consistent_state(drawing)
    try:
        equilibrium = EquilibriumState(drawing.mechanism())
    except bd.BeamdaeError as refused:
        assume(not any(words in str(refused) for words in NO_EQUILIBRIUM))
        raise
    # The notes mention equilibria that are not isolated.
    path = equilibrium.path
    assume(path.status.success and path.stable and not path.notes)
    return equilibrium


def check_equilibrium(drawing: Drawing, rng: Random) -> None:
    state = find_equilibrium_state(drawing)
    e = state.equations
    residual = np.abs(state.force(q=state.q) + state.joint_forces)
    # Relative to the forces that displacements of natural size cause.
    gross = np.abs(state.stiffness(q=state.q)) @ (np.abs(state.q) + e.position_scales)
    gross += np.abs(state.joint_forces)
    assert np.max(residual * e.position_scales) <= 1e-9 * np.max(gross * e.position_scales)
    gaps = state.levels[0](q=state.q)
    assert np.max(np.abs(gaps), initial=0.0) <= 1e-9 * max(1.0, e.length)


def check_equilibrium_invariance(drawing: Drawing, rng: Random) -> None:
    """Compare the equilibrium under other positions, units and orders of the parts."""
    state = find_equilibrium_state(drawing)
    others = {
        name: (EquilibriumState(drawing.mechanism(frame)), frame)
        for name, frame in similarity_transformations(rng).items()
    }
    others["order"] = EquilibriumState(drawing.mechanism(order=rng)), Similarity()
    for name, (other, frame) in others.items():
        assert other.path.status.success, f"{name}: {other.path.status.sentence}"
        error = state.relative_differences(other, frame)["q"]
        assert error <= 1e-7, f"{name}: {error:g}"
        assert other.path.unstable[-1] == state.path.unstable[-1], name


EQUILIBRIUM_LAWS = {
    "rest": (check_equilibrium, {"free": False}),
    "frames of rest": (check_equilibrium_invariance, {"free": False}),
}
