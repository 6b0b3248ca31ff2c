"""Laws of random mechanisms at one state: of mechanics, and of how they are drawn."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import TypeVar

import numpy as np
from hypothesis import assume
from properties.drawings import Drawing
from properties.frames import Frame
from properties.mechanics import State, observe_pulls

import beamdae as bd

T = TypeVar("T")

# What may be said of a drawing that contradicts itself.
REFUSALS = (
    *("depend on each other", "Painleve", "cannot be closed"),
    *("are drawn at one place", "that lie apart in the reference drawing"),
)


def unrefused(build: Callable[[], T]) -> T:
    """What is built, unless the drawing contradicts itself."""
    try:
        return build()
    except bd.BeamdaeError as refused:
        assume(not any(words in str(refused) for words in REFUSALS))
        raise


def built(drawing: Drawing, mechanism: bd.Mechanism | None = None) -> State:
    """Its consistent start, where its joints are independent and not near to losing rank."""
    state = unrefused(lambda: State(mechanism or drawing.mechanism()))
    assume(state.is_well_posed)
    return state


def the_energy_changes_by_what_is_booked(drawing: Drawing, rng: Random) -> None:
    state = built(drawing)
    rate, power, terms = state.powers()
    asked = state.energies(q=state.q, v=state.equations.v0)[0]
    size = max(np.max(np.abs(terms)), 1e-2 * asked * state.rate, 1e-6)
    # Of differences along a motion that changes at a rate that is guessed; 1e-12 W is rounding.
    assert abs(rate - power) <= 1e-6 * size


def nothing_changes_the_momentum_from_inside(drawing: Drawing, rng: Random) -> None:
    state = built(drawing)
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


def the_ground_balances_the_rate_of_momentum(drawing: Drawing, rng: Random) -> None:
    """Reactions of the ground and weight, about the origin."""
    held = drawing.held
    state = built(drawing, observe_pulls(drawing.mechanism(), held))
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


def frames(rng: Random) -> dict[str, Frame]:
    """Moved and turned, seen in a mirror, in other units, and all of it.

    Units further away cost digits: the dense factors of what is a thousandth as long and as heavy
    leave 2e-8 of the velocities.
    """
    turn = rng.uniform(-3.0, 3.0)
    shift = rng.uniform(-5.0, 5.0), rng.uniform(-5.0, 5.0)
    return {
        "moved": Frame(angle=turn, shift=shift),
        "mirrored": Frame(angle=turn, mirrored=True),
        "mm, g": Frame(length=1e3, mass=1e3),
        "ten times as large": Frame(length=0.1, mass=1e-2),
        "mm, ms": Frame(length=1e3, time=1e3),
        "all": Frame(turn, shift, mirrored=True, length=1e-1, mass=1e2, time=1e2),
    }


def nothing_depends_on_where_and_in_which_units_it_is_drawn(drawing: Drawing, rng: Random) -> None:
    state = built(drawing)
    # Joints that are open in the drawing are closed in a metric of one second.
    is_open = np.max(np.abs(state.levels[0]()), initial=0.0) > 1e-13
    for name, frame in frames(rng).items():
        if is_open and frame.time != 1.0:
            continue
        unlike = state.unlike(State(drawing.mechanism(frame)), frame)
        assert max(unlike.values()) <= 1e-8, f"{name}: {unlike}"


def nothing_depends_on_the_order_of_parts(drawing: Drawing, rng: Random) -> None:
    state = built(drawing)
    unlike = state.unlike(State(drawing.mechanism(order=rng)), Frame())
    assert max(unlike.values()) <= 1e-8, unlike


# By name, each with what is drawn for it.
STATE_LAWS = {
    "energy": (the_energy_changes_by_what_is_booked, {}),
    "momentum": (nothing_changes_the_momentum_from_inside, {"free": True}),
    "ground": (the_ground_balances_the_rate_of_momentum, {"free": False, "outside": False}),
    "frames": (nothing_depends_on_where_and_in_which_units_it_is_drawn, {}),
    "order": (nothing_depends_on_the_order_of_parts, {}),
}
