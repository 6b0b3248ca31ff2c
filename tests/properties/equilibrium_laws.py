"""Laws of random mechanisms at rest."""

from __future__ import annotations

from random import Random

import numpy as np
from hypothesis import assume
from properties.drawings import Drawing
from properties.mechanism_state import MechanismState
from properties.similarity import Similarity
from properties.state_laws import consistent_state, similarity_transformations

import beamdae as bd

# What is said of what does not come to rest, or where joints leave that open.
NO_EQUILIBRIUM = ("no equilibrium was found", "constrains velocities alone")


class EquilibriumState(MechanismState):
    """The equilibrium of a mechanism as a state: without velocities.

    With all loads from the beginning, for without them it may rest anywhere.
    """

    def __init__(self, mechanism: bd.Mechanism) -> None:
        super().__init__(mechanism)
        self.path = bd.equilibrium(self.equations)
        self.time = np.zeros(2)
        self.q, self.lam = self.path.q[-1], self.path.lam[-1]
        self.v = self.a = np.zeros(self.n)


def find_equilibrium_state(drawing: Drawing) -> EquilibriumState:
    """Where it rests, if it does somewhere that is stable and no motion away is free."""
    consistent_state(drawing)
    try:
        found = EquilibriumState(drawing.mechanism())
    except bd.BeamdaeError as refused:
        assume(not any(words in str(refused) for words in NO_EQUILIBRIUM))
        raise
    # What rests anywhere along a motion is noted.
    assume(found.path.status.success and found.path.stable and not found.path.notes)
    return found


def check_equilibrium(drawing: Drawing, rng: Random) -> None:
    found = find_equilibrium_state(drawing)
    e = found.equations
    left = np.abs(found.force(q=found.q) + found.held)
    # It would move nothing by more than this share of its size.
    gross = np.abs(found.stiffness(q=found.q)) @ (np.abs(found.q) + e.position_scales)
    gross += np.abs(found.held)
    assert np.max(left * e.position_scales) <= 1e-9 * np.max(gross * e.position_scales)
    gaps = found.levels[0](q=found.q)
    assert np.max(np.abs(gaps), initial=0.0) <= 1e-9 * max(1.0, e.length)


def check_equilibrium_invariance(drawing: Drawing, rng: Random) -> None:
    """On where it is drawn, units, the order of its parts."""
    found = find_equilibrium_state(drawing)
    others = {
        name: (EquilibriumState(drawing.mechanism(frame)), frame)
        for name, frame in similarity_transformations(rng).items()
    }
    others["order"] = EquilibriumState(drawing.mechanism(order=rng)), Similarity()
    for name, (other, frame) in others.items():
        assert other.path.status.success, f"{name}: {other.path.status.sentence}"
        off = found.unlike(other, frame)["q"]
        assert off <= 1e-7, f"{name}: {off:g}"
        assert other.path.unstable[-1] == found.path.unstable[-1], name


EQUILIBRIUM_LAWS = {
    "rest": (check_equilibrium, {"free": False}),
    "frames of rest": (check_equilibrium_invariance, {"free": False}),
}
