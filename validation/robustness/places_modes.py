"""Public names in small working calls: natural modes, Campbell diagrams, linear models."""

from __future__ import annotations

from pathlib import Path

import beamdae as bd
from robustness.world import KNEE, Base, World, itself


def _turned(world: World) -> bd.Mechanism:
    """A disk on an axle, on which a small body is held by springs: it may turn steadily."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("bar", 1.0, 0.1))
    bob = mech.add(bd.RigidBody("bob", 0.5, 0.01))
    hub = disk.at(0.0, 0.0)
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), hub))
    mech.add(bd.Bushing("cross", hub, bob.at(0.0, 0.0), 100.0, 200.0, 10.0))
    return mech


def _pushed(world: World) -> bd.Mechanism:
    world.mech.add(bd.Force("push", world.bar.at(*KNEE), (0.0, 0.0)))
    return world.mech


MODES: dict[str, Base] = {
    "modes": Base(
        lambda w: {"model": w.mech, "about": "reference", "n": 3, "damping": True, "t": 0.0},
        lambda w, found: found.table(),
    ),
    "modes about": Base(
        lambda w: {"about": {"bar.angle": -1.0}},
        lambda w, found: found.table(),
        lambda w, about: bd.modes(w.mech, about=about),
    ),
    "rotation": Base(
        lambda w: {"speed": 1.0, "center": (0.0, 0.0)},
        lambda w, about: bd.modes(_turned(w), about=about).table(),
    ),
    "Solution.at": Base(
        lambda w: {"t": 0.005}, lambda w, at: bd.modes(w.mech, at), lambda w, t: w.solution.at(t)
    ),
    "Modes.mac": Base(
        lambda w: {"other": bd.modes(w.mech)},
        itself,
        lambda w, other: bd.modes(w.mech).mac(other),
    ),
    "campbell": Base(
        lambda w: {
            "model": _turned(w),
            "speeds": [0.0, 1.0],
            "n": 2,
            "center": (0.0, 0.0),
            "damping": True,
        },
        lambda w, found: found.table(),
    ),
    "linearize": Base(
        lambda w: {
            "model": _pushed(w),
            "about": "equilibrium",
            "inputs": ["push"],
            "outputs": ["knee"],
            "t": 0.0,
        },
        itself,
    ),
    "LinearModel.frequency_response": Base(
        lambda w: {"frequencies": [0.0, 1.0]},
        itself,
        lambda w, frequencies: bd.linearize(_pushed(w)).frequency_response(frequencies),
    ),
    "draw_modes": Base(lambda w: {"modes": bd.modes(w.mech)}, itself),
    "animate_mode": Base(
        lambda w: {"modes": bd.modes(w.mech), "mode": 1, "path": Path("out/mode.gif"), "frames": 2},
        itself,
    ),
    "draw_campbell": Base(lambda w: {"found": bd.campbell(_turned(w), [0.0, 1.0])}, itself),
}
