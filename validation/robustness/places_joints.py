"""Working calls of joints: drivers, gears, rolling, blades and friction."""

from __future__ import annotations

from typing import Any

import beamdae as bd
from robustness.world import KNEE, Base, World, added


def _pair(world: World, name: str) -> dict[str, Any]:
    post = world.mech.add(bd.RigidBody("post", 1.0, 0.1, KNEE))
    return {"name": name, "a": world.bar.at(*KNEE), "b": post.at(*KNEE)}


def _apart(world: World, name: str) -> dict[str, Any]:
    post = world.mech.add(bd.RigidBody("post", 1.0, 0.1, KNEE))
    return {"name": name, "a": world.bar.at(*KNEE), "b": post.at(KNEE[0] + 1.0, KNEE[1])}


def _bead(world: World) -> bd.Attachment:
    return world.mech.add(bd.PointMass("bead", 0.1, at=world.beam.at(0.5).point)).point


def _disk(world: World, height: float) -> bd.Attachment:
    return world.mech.add(bd.RigidBody("disk", 1.0, 0.1, (0.0, height))).at(0.0, height)


def _above(world: World, height: float) -> dict[str, Any]:
    return {"a": world.mech.ground.at(0.0, 0.0), "b": _disk(world, height)}


def _rail(world: World) -> bd.PointOnLine:
    slider = world.mech.add(bd.RigidBody("slider", 1.0, 0.1, (3.0, 0.0)))
    ends = world.mech.ground.at(3.0, 0.0), slider.at(3.0, 0.0)
    return world.mech.add(bd.PointOnLine("rail", *ends, direction=(1.0, 0.0)))


JOINTS: dict[str, Base] = {
    "Distance": Base(lambda w: {**_apart(w, "link"), "length": 1.0}, added),
    "Driver": Base(lambda w: {**_pair(w, "motor"), "law": 0.0}, added),
    "Friction": Base(
        lambda w: {
            "name": "rub",
            "joint": w.mech.part("hinge"),
            "coefficient": 0.2,
            "regularization": 0.1,
            "static": 0.3,
            "stribeck": 0.5,
            "radius": 0.02,
            "smoothing": 1e-3,
        },
        added,
    ),
    "Friction in a guide": Base(
        lambda w: {"name": "rub", "joint": _rail(w), "coefficient": 0.2, "regularization": 0.1},
        added,
    ),
    "Gear": Base(
        lambda w: {**_pair(w, "gear"), "ratio": -0.5, "carrier": w.mech.ground.at(0.0, 0.0)}, added
    ),
    "PointOnLine": Base(lambda w: {**_pair(w, "guide"), "direction": (1.0, 0.0)}, added),
    "Prismatic": Base(lambda w: {**_pair(w, "rail"), "direction": (1.0, 0.0)}, added),
    "RackAndPinion": Base(
        lambda w: {**_pair(w, "rack"), "radius": 0.2, "direction": (1.0, 0.0)}, added
    ),
    "Revolute": Base(lambda w: _pair(w, "pin"), added),
    "RollingOnCircle": Base(
        lambda w: {"name": "wheel", **_above(w, 1.5), "radii": (1.0, 0.5)}, added
    ),
    "RollingOnLine": Base(
        lambda w: {"name": "wheel", **_above(w, 0.5), "radius": 0.5, "direction": (1.0, 0.0)}, added
    ),
    "Skate": Base(lambda w: {"name": "blade", "on": _disk(w, 1.0), "direction": (1.0, 0.0)}, added),
    "SlidingOnBeam": Base(
        lambda w: {"name": "slide", "a": _bead(w), "beam": w.beam, "ends": "record"},
        added,
    ),
    "TranslationalDriver": Base(
        lambda w: {**_pair(w, "motor"), "law": 0.0, "direction": (1.0, 0.0)}, added
    ),
    "Weld": Base(lambda w: _pair(w, "weld"), added),
}
