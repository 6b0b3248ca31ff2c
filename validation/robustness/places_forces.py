"""Working calls of springs, contacts and forces of one's own."""

from __future__ import annotations

from typing import Any

import beamdae as bd
from robustness.world import KNEE, Base, World, added, itself


def _ends(world: World) -> dict[str, Any]:
    return {"name": "spring", "a": world.mech.ground.at(3.0, 1.0), "b": world.bar.at(*KNEE)}


def _law(x: Any, rate: Any) -> Any:
    return 2.0 * x + 0.1 * rate


def _energy(x: Any) -> Any:
    return x**2


def _shove(point: Any, t: Any) -> Any:
    return (1.0 - point.velocity[0], 0.0)


def _stored(point: Any) -> Any:
    return 0.5 * point.position[0] ** 2


def _with(world: World, **given: Any) -> dict[str, Any]:
    return {**_ends(world), **given}


_LAWFUL: dict[str, Any] = {"law": _law, "energy": _energy}
_LINEAR: dict[str, Any] = {"stiffness": 2.0, "free_length": 0.9, "preload": 0.1}
_TURNED: dict[str, Any] = {"stiffness": 2.0, "damping": 0.1, "free_angle": 0.1, "preload": 0.1}
_HELD = {"kx": 2.0, "ky": 1.0, "ktheta": 0.3, "cx": 0.1, "cy": 0.1, "ctheta": 0.1, "angle": 0.2}


def _bushing_law(x: Any, rate: Any) -> Any:
    return (2.0 * x[0], x[1], x[2])


def _bushing_energy(x: Any) -> Any:
    return x[0] ** 2 + 0.5 * x[1] ** 2 + 0.5 * x[2] ** 2


def _contact(world: World) -> dict[str, Any]:
    return {
        "name": "stop",
        "point": world.bar.at(*KNEE),
        "surface": bd.LineSurface(world.mech.ground.at(0.0, -0.1)),
        "stiffness": 1e4,
        "exponent": 1.5,
        "restitution": 0.5,
        "impact_speed": 1.0,
        "friction": 0.1,
        "friction_speed": 0.1,
        "longest_step": 0.01,
    }


FORCES: dict[str, Base] = {
    "Bushing": Base(lambda w: _with(w, **_HELD), added),
    "Bushing of a law": Base(
        lambda w: _with(w, law=_bushing_law, energy=_bushing_energy),
        added,
        lambda w, **given: bd.Bushing(**given),
    ),
    "CircleSurface": Base(
        lambda w: {"on": w.mech.ground.at(0.0, 9.0), "radius": 1.0, "side": "outside"}, itself
    ),
    "Contact": Base(_contact, added),
    "Damper": Base(lambda w: _with(w, damping=0.1), added),
    "Damper of a law": Base(
        lambda w: _with(w, law=_law), added, lambda w, **given: bd.Damper(**given)
    ),
    "DistributedForce": Base(
        lambda w: {"name": "load", "beam": w.beam, "law": (0.0, 1.0), "axes": "section"}, added
    ),
    "ForceLaw": Base(
        lambda w: {
            "name": "load",
            "on": w.bar.at(*KNEE),
            "law": _shove,
            "energy": _stored,
            "dissipative": False,
        },
        added,
    ),
    "LineSurface": Base(
        lambda w: {"on": w.mech.ground.at(0.0, 0.0), "direction": (1.0, 0.0)}, itself
    ),
    "MovingForce": Base(
        lambda w: {
            "name": "load",
            "beam": w.beam,
            "force": (0.0, 1.0),
            "speed": 1.0,
            "start": 0.0,
        },
        added,
    ),
    "Spring": Base(lambda w: _with(w, **_LINEAR), added),
    "Spring of a law": Base(
        lambda w: _with(w, **_LAWFUL), added, lambda w, **given: bd.Spring(**given)
    ),
    "SpringDamper": Base(lambda w: _with(w, damping=0.1, **_LINEAR), added),
    "SpringDamper of a law": Base(
        lambda w: _with(w, **_LAWFUL), added, lambda w, **given: bd.SpringDamper(**given)
    ),
    "TorsionDamper": Base(lambda w: _with(w, damping=0.1), added),
    "TorsionDamper of a law": Base(
        lambda w: _with(w, law=_law), added, lambda w, **given: bd.TorsionDamper(**given)
    ),
    "TorsionSpring": Base(lambda w: _with(w, **_TURNED), added),
    "TorsionSpring of a law": Base(
        lambda w: _with(w, **_LAWFUL), added, lambda w, **given: bd.TorsionSpring(**given)
    ),
    "positive_part": Base(lambda w: {"x": 1.0}, itself),
    "smooth_sign": Base(lambda w: {"x": 1.0, "scale": 1.0}, itself),
}
