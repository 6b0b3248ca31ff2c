"""Laws of random mechanisms at one state: of mechanics, and of how they are drawn."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import TypeVar

import numpy as np
from hypothesis import assume
from properties.drawings import Drawing
from properties.mechanism_state import MechanismState, observe_ground_reactions
from properties.similarity import Similarity

import beamdae as bd

T = TypeVar("T")

# What may be said of a drawing that contradicts itself.
CONTRADICTIONS = (
    *("depend on each other", "Painleve", "cannot be closed"),
    *("are drawn at one place", "that lie apart in the reference drawing"),
)


def build_unless_contradictory(build: Callable[[], T]) -> T:
    """What is built, unless the drawing contradicts itself."""
    try:
        return build()
    except bd.BeamdaeError as refused:
        assume(not any(words in str(refused) for words in CONTRADICTIONS))
        raise


def consistent_state(drawing: Drawing, mechanism: bd.Mechanism | None = None) -> MechanismState:
    """Its consistent start, where its joints are independent and not near to losing rank."""
    state = build_unless_contradictory(lambda: MechanismState(mechanism or drawing.mechanism()))
    assume(state.is_well_posed)
    return state


def check_energy_balance(drawing: Drawing, rng: Random) -> None:
    state = consistent_state(drawing)
    rate, power, terms = state.powers()
    asked = state.energies(q=state.q, v=state.equations.v0)[0]
    size = max(np.max(np.abs(terms)), 1e-2 * asked * state.rate, 1e-6)
    # Of differences along a motion that changes at a rate that is guessed; 1e-12 W is rounding.
    assert abs(rate - power) <= 1e-6 * size


def check_internal_momentum(drawing: Drawing, rng: Random) -> None:
    state = consistent_state(drawing)
    assert drawing.is_free
    # Momentum is linear in accelerations: its rate is what moves it as a whole in the residual.
    travel = state.travel(state.q)
    balance = state.force(q=state.q, v=state.v, a=state.a) + state.held
    size = np.max(np.abs(state.mass(q=state.q) @ state.a), initial=0.0)
    size += np.max(np.abs(state.held), initial=0.0)
    size += np.max(np.abs(state.force(q=state.q, v=state.v)))
    assert np.max(np.abs(travel.T @ balance)) <= 1e-9 * size
    rate = state.moving(state.momentum)
    assert np.max(np.abs(rate)) <= 1e-7 * (size + np.max(np.abs(state.momentum(state.q, state.v))))


def check_ground_reactions(drawing: Drawing, rng: Random) -> None:
    """Reactions of the ground and weight, about the origin."""
    held = drawing.held
    state = consistent_state(drawing, observe_ground_reactions(drawing.mechanism(), held))
    travel = state.travel(state.q)
    inertia = travel.T @ state.mass(q=state.q) @ travel
    mass, moments = inertia[0, 0], inertia[:2, 2]
    weight = np.array([0.0, mass * drawing.gravity[1], moments[1] * drawing.gravity[1]])
    pulls = state.pulls(held)
    rate = state.moving(state.momentum)
    size = (
        np.max(np.abs(pulls), initial=0.0)
        + np.max(np.abs(weight))
        + np.max(np.abs(state.held), initial=0.0)
    )
    size += np.max(np.abs(state.momentum(state.q, state.v))) * state.rate
    assert np.max(np.abs(rate - weight - pulls.sum(axis=0))) <= 1e-7 * size


def similarity_transformations(rng: Random) -> dict[str, Similarity]:
    """Moved and turned, seen in a mirror, in other units, and all of it.

    Units further away cost digits: the dense factors of what is a thousandth as long and as heavy
    leave 2e-8 of the velocities.
    """
    turn = rng.uniform(-3.0, 3.0)
    shift = rng.uniform(-5.0, 5.0), rng.uniform(-5.0, 5.0)
    return {
        "moved": Similarity(angle=turn, shift=shift),
        "mirrored": Similarity(angle=turn, mirrored=True),
        "mm, g": Similarity(length=1e3, mass=1e3),
        "ten times as large": Similarity(length=0.1, mass=1e-2),
        "mm, ms": Similarity(length=1e3, time=1e3),
        "all": Similarity(turn, shift, mirrored=True, length=1e-1, mass=1e2, time=1e2),
    }


def check_similarity_invariance(drawing: Drawing, rng: Random) -> None:
    state = consistent_state(drawing)
    # Joints that are open in the drawing are closed in a metric of one second.
    is_open = np.max(np.abs(state.levels[0]()), initial=0.0) > 1e-13
    for name, frame in similarity_transformations(rng).items():
        if is_open and frame.time != 1.0:
            continue
        unlike = state.unlike(MechanismState(drawing.mechanism(frame)), frame)
        assert max(unlike.values()) <= 1e-8, f"{name}: {unlike}"


def check_order_invariance(drawing: Drawing, rng: Random) -> None:
    state = consistent_state(drawing)
    unlike = state.unlike(MechanismState(drawing.mechanism(order=rng)), Similarity())
    assert max(unlike.values()) <= 1e-8, unlike


# By name, each with what is drawn for it.
STATE_LAWS = {
    "energy": (check_energy_balance, {}),
    "momentum": (check_internal_momentum, {"free": True}),
    "ground": (check_ground_reactions, {"free": False, "outside": False}),
    "frames": (check_similarity_invariance, {}),
    "order": (check_order_invariance, {}),
}
