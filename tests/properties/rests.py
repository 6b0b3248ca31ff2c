"""Laws of random mechanisms at rest."""

from __future__ import annotations

from random import Random

import numpy as np
from hypothesis import assume
from properties.drawings import Drawing
from properties.frames import Frame
from properties.mechanics import State
from properties.states import built, frames

import beamdae as bd

# What is said of what does not come to rest, or where joints leave that open.
NOWHERE = ("no equilibrium was found", "holds velocities alone")


class Rest(State):
    """The equilibrium of a mechanism as a state: without velocities.

    With all loads from the beginning, for without them it may rest anywhere.
    """

    def __init__(self, mechanism: bd.Mechanism) -> None:
        super().__init__(mechanism)
        self.path = bd.equilibrium(self.equations)
        self.time = np.zeros(2)
        self.q, self.lam = self.path.q[-1], self.path.lam[-1]
        self.v = self.a = np.zeros(self.n)


def rest(drawing: Drawing) -> Rest:
    """Where it rests, if it does somewhere that is stable and no motion away is free."""
    built(drawing)
    try:
        found = Rest(drawing.mechanism())
    except bd.BeamdaeError as refused:
        assume(not any(words in str(refused) for words in NOWHERE))
        raise
    # What rests anywhere along a motion is noted.
    assume(found.path.status.success and found.path.stable and not found.path.notes)
    return found


def nothing_is_left_over(drawing: Drawing, rng: Random) -> None:
    found = rest(drawing)
    e = found.equations
    left = np.abs(found.force(q=found.q) + found.held)
    # It would move nothing by more than this share of its size.
    gross = np.abs(found.stiffness(q=found.q)) @ (np.abs(found.q) + e.position_scales)
    gross += np.abs(found.held)
    assert np.max(left * e.position_scales) <= 1e-9 * np.max(gross * e.position_scales)
    gaps = found.levels[0](q=found.q)
    assert np.max(np.abs(gaps), initial=0.0) <= 1e-9 * max(1.0, e.length)


def rest_does_not_depend_on_the_drawing(drawing: Drawing, rng: Random) -> None:
    """On where it is drawn, units, the order of its parts."""
    found = rest(drawing)
    others = {name: (Rest(drawing.mechanism(frame)), frame) for name, frame in frames(rng).items()}
    others["order"] = Rest(drawing.mechanism(order=rng)), Frame()
    for name, (other, frame) in others.items():
        assert other.path.status.success, f"{name}: {other.path.status.sentence}"
        off = found.unlike(other, frame)["q"]
        assert off <= 1e-7, f"{name}: {off:g}"
        assert other.path.unstable[-1] == found.path.unstable[-1], name


REST_LAWS = {
    "rest": (nothing_is_left_over, {"free": False}),
    "frames of rest": (rest_does_not_depend_on_the_drawing, {"free": False}),
}
