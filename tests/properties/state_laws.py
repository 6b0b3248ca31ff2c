"""Properties of random mechanisms at one state: balances, and invariance of the results."""

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

# Parts of the errors about contradictory drawings.
CONTRADICTIONS = (
    *("depend on each other", "Painleve", "cannot be closed"),
    *("coincide in the reference configuration", "coincide in the reference configuration"),
)


def build_unless_contradictory(build: Callable[[], T]) -> T:
    """Return `build()`; reject the example if the drawing is contradictory."""
    try:
        return build()
    except bd.BeamdaeError as refused:
        assume(not any(words in str(refused) for words in CONTRADICTIONS))
        raise


def consistent_state(drawing: Drawing, mechanism: bd.Mechanism | None = None) -> MechanismState:
    """Return the consistent initial state; reject examples with nearly dependent joints."""
    state = build_unless_contradictory(lambda: MechanismState(mechanism or drawing.mechanism()))
    assume(state.is_well_posed)
    return state


def check_energy_balance(drawing: Drawing, rng: Random) -> None:
    state = consistent_state(drawing)
    rate, power, terms = state.powers()
    initial_energy = state.energies(q=state.q, v=state.equations.v0)[0]
    size = max(np.max(np.abs(terms)), 1e-2 * initial_energy * state.rate, 1e-6)
    # Error of the finite differences; 1e-12 W is rounding.
    assert abs(rate - power) <= 1e-6 * size


def check_internal_momentum(drawing: Drawing, rng: Random) -> None:
    state = consistent_state(drawing)
    assert drawing.is_free
    # The rate of momentum is the residual projected onto the rigid motions.
    rigid = state.rigid_motions(state.q)
    balance = state.force(q=state.q, v=state.v, a=state.a) + state.joint_forces
    size = np.max(np.abs(state.mass(q=state.q) @ state.a), initial=0.0)
    size += np.max(np.abs(state.joint_forces), initial=0.0)
    size += np.max(np.abs(state.force(q=state.q, v=state.v)))
    assert np.max(np.abs(rigid.T @ balance)) <= 1e-9 * size
    rate = state.rate_along_motion(state.momentum)
    assert np.max(np.abs(rate)) <= 1e-7 * (size + np.max(np.abs(state.momentum(state.q, state.v))))


def check_ground_reactions(drawing: Drawing, rng: Random) -> None:
    """Ground reactions and weight balance the rate of momentum about the origin."""
    joints = drawing.ground_joints
    state = consistent_state(drawing, observe_ground_reactions(drawing.mechanism(), joints))
    rigid = state.rigid_motions(state.q)
    inertia = rigid.T @ state.mass(q=state.q) @ rigid
    mass, moments = inertia[0, 0], inertia[:2, 2]
    weight = np.array([0.0, mass * drawing.gravity[1], moments[1] * drawing.gravity[1]])
    reactions = state.ground_reactions(joints)
    rate = state.rate_along_motion(state.momentum)
    size = (
        np.max(np.abs(reactions), initial=0.0)
        + np.max(np.abs(weight))
        + np.max(np.abs(state.joint_forces), initial=0.0)
    )
    size += np.max(np.abs(state.momentum(state.q, state.v))) * state.rate
    assert np.max(np.abs(rate - weight - reactions.sum(axis=0))) <= 1e-7 * size


def similarity_transformations(rng: Random) -> dict[str, Similarity]:
    """Return transformations: displaced and rotated, mirrored, in other units, and combined.

    More extreme units cost digits: for a mechanism a thousandth as long and as heavy, the dense
    factorization has errors of 2e-8 of the velocities.
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
    for name, frame in similarity_transformations(rng).items():
        differences = state.relative_differences(MechanismState(drawing.mechanism(frame)), frame)
        assert max(differences.values()) <= 1e-8, f"{name}: {differences}"


def check_order_invariance(drawing: Drawing, rng: Random) -> None:
    state = consistent_state(drawing)
    differences = state.relative_differences(
        MechanismState(drawing.mechanism(order=rng)), Similarity()
    )
    assert max(differences.values()) <= 1e-8, differences


# Check and options of `draw_mechanism` by name.
STATE_LAWS = {
    "energy": (check_energy_balance, {}),
    "momentum": (check_internal_momentum, {"free": True}),
    "ground": (check_ground_reactions, {"free": False, "outside": False}),
    "frames": (check_similarity_invariance, {}),
    "order": (check_order_invariance, {}),
}


# Properties of random mechanisms in equilibrium.

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
