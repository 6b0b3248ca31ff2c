"""Public names in small working calls: equilibria."""

from __future__ import annotations

import beamdae as bd
from robustness.world import KNEE, Base, World, itself


def _leaning(world: World) -> bd.Mechanism:
    """The bar on a torsion spring, pushed aside."""
    foot = world.mech.ground.at(0.0, 0.0)
    world.mech.add(bd.TorsionSpring("spring", foot, world.bar.at(0.0, 0.0), 10.0))
    world.mech.add(bd.Force("push", world.bar.at(*KNEE), (0.0, 1.0)))
    return world.mech


STATICS: dict[str, Base] = {
    "equilibrium": Base(
        lambda w: {
            "model": w.mech,
            "loads": ["gravity"],
            "to": [0.5, 1.0],
            "control": "load",
            "step": 0.5,
            "switch": 0,
            "most_points": 20,
            "t": 0.0,
            "start": {"bar.angle": -1.0},
        },
        lambda w, found: found.table(),
    ),
    "equilibrium displaced": Base(
        lambda w: {"to": {"knee.x": 0.1}, "switch": 0},
        lambda w, found: found.table(),
        lambda w, **given: bd.equilibrium(_leaning(w), **given),
    ),
    "Equilibrium.at": Base(
        lambda w: {"row": 0}, itself, lambda w, row: bd.equilibrium(w.mech).at(row)
    ),
    "equilibrium switched": Base(
        lambda w: {"to": {"knee.x": 0.1}, "switch": [1, -1], "most_points": 20},
        lambda w, found: found.table(),
        lambda w, **given: bd.equilibrium(_leaning(w), **given),
    ),
    "Equilibrium.__getitem__": Base(
        lambda w: {"name": "knee.x"}, itself, lambda w, name: bd.equilibrium(w.mech)[name]
    ),
    "Equilibrium.plot": Base(
        lambda w: {"name": "knee"}, itself, lambda w, name: bd.equilibrium(w.mech).plot(name)
    ),
    "modes about a path": Base(
        lambda w: {"about": bd.equilibrium(w.mech)},
        itself,
        lambda w, about: bd.modes(w.mech, about=about),
    ),
}
