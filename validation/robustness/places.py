"""Public names in small working calls: parts, curves, laws, mechanisms."""

from __future__ import annotations

from typing import Any

import beamdae as bd
from robustness.world import (
    KNEE,
    Base,
    World,
    added,
    bent,
    held,
    itself,
    loaded,
    made_of,
    observed,
)

_PROPERTIES = ("coordinates", "initial_position", "initial_velocity", "outline", "laws")
_METHODS = ("forces", "constraints", "ranges", "draw")
# What a member says that nobody changed.
_ITS_OWN = object()


def _extended(world: World, **members: Any) -> bd.Part:
    """A part of a user's own, one member of which says something else."""
    answers = {
        name: (lambda self, *a, value=value: value)
        if name in _METHODS
        else property(lambda self, value=value: value)
        for name, value in members.items()
        if value is not _ITS_OWN
    }
    return type("Odd", (bd.RigidBody,), answers)("odd", 1.0, 0.1, (3.0, 0.0))


def _members(world: World) -> dict[str, Any]:
    return dict.fromkeys((*_PROPERTIES, *_METHODS), _ITS_OWN)


def _attachment(world: World) -> dict[str, Any]:
    at = world.bar.at(*KNEE)
    names = ("body", "point", "inclination", "operator", "kinematics", "has_angle", "s")
    return {name: getattr(at, name) for name in names}


def _pinned(world: World, place: Any) -> bd.Solution:
    post = world.mech.add(bd.RigidBody("post", 1.0, 0.1, (4.0, 0.0)))
    return added(world, bd.Revolute("pin", place, post.at(3.0, 0.0)))


def _falling(world: World, mech: bd.Mechanism) -> bd.Solution:
    bob = mech.add(bd.RigidBody("bob", 1.0, 0.1))
    mech.observe("place", bob.at(0.0, 0.0))
    return world.run(mech)


def _watched(world: World, name: str, what: Any) -> bd.Solution:
    world.mech.observe(name, what)
    return world.run()


VARIANTS: dict[str, Base] = {
    "Attachment": Base(_attachment, held),
    "activate": Base(
        lambda w: {"part": w.mech.part("hinge"), "as_is": True},
        itself,
        lambda w, part, as_is: bd.activate(part, as_is=as_is),
    ),
    "deactivate": Base(
        lambda w: {"part": bd.Moment("load", w.bar.at(*KNEE), 1.0)},
        itself,
        lambda w, part: bd.deactivate(part),
    ),
    "change_law": Base(
        lambda w: {
            "driver": bd.Driver("driver", w.mech.ground.at(*KNEE), w.bar.at(*KNEE), 0.0),
            "law": 1.0,
        },
        itself,
    ),
    "impact": Base(lambda w: {"on": w.mech.part("hinge"), "restitution": 0.5}, itself),
    "Part": Base(_members, added, _extended),
    "PointMass on": Base(
        lambda w: {"name": "mass", "mass": 0.1, "on": w.bar.at(*KNEE)},
        added,
    ),
    "RigidBody.rod": Base(
        lambda w: {
            "name": "rod",
            "a": (3.0, 0.0),
            "b": (4.0, 0.0),
            "density": 7850.0,
            "area": 1e-4,
        },
        added,
        lambda w, **given: bd.RigidBody.rod(**given),
    ),
    "welded_beams": Base(
        lambda w: {
            "mechanism": w.mech,
            "name": "strip",
            "curve": bd.Line((0.0, 1.0), (1.0, 1.0)),
            "section": w.section,
            "bodies": 2,
            "closed": False,
            "elements": 1,
        },
        lambda w, made: w.run(),
    ),
    "frame": Base(
        lambda w: {
            "mechanism": w.mech,
            "name": "rack",
            "points": {"A": (0.0, 1.0), "B": (1.0, 1.0), "C": (1.0, 2.0)},
            "members": ("AB", "BC"),
            "section": w.section,
            "elements": 1,
        },
        lambda w, made: w.run(),
    ),
}

NUMBERS: dict[str, Base] = {
    "Curve of points": Base(
        lambda w: {"points": [(0.0, 0.0), (1.0, 0.1), (2.0, 0.1), (3.0, 0.0)], "noise": 1e-3},
        bent,
    ),
    "Section.rectangle": Base(
        lambda w: {"material": w.material, "width": 0.02, "height": 0.004, "damping": 0.0},
        made_of,
        lambda w, **given: bd.Section.rectangle(**given),
    ),
    "Section.circle": Base(
        lambda w: {"material": w.material, "diameter": 0.01, "damping": 0.0},
        made_of,
        lambda w, **given: bd.Section.circle(**given),
    ),
    "Section.pipe": Base(
        lambda w: {"material": w.material, "diameter": 0.01, "wall": 0.001, "damping": 0.0},
        made_of,
        lambda w, **given: bd.Section.pipe(**given),
    ),
    "piecewise": Base(
        lambda w: {"end": 0.005, "law": 1.0, "last": 0.0},
        loaded,
        lambda w, end, law, last: bd.piecewise((end, law), last),
    ),
    "piecewise entry": Base(
        lambda w: {"piece": (0.005, 1.0)}, loaded, lambda w, piece: bd.piecewise(piece, 0.0)
    ),
}

MECHANISMS: dict[str, Base] = {
    "Mechanism": Base(
        lambda w: {"gravity": (0.0, -9.81), "start": "as drawn", "redundant": "refuse"},
        lambda w, mech: _falling(w, mech),
    ),
    "Mechanism.add": Base(
        lambda w: {"part": bd.RigidBody("disk", 1.0, 0.1)},
        lambda w, made: w.run(),
        lambda w, part: w.mech.add(part),
    ),
    "Mechanism.observe": Base(
        lambda w: {"name": "watched", "what": w.bar.at(0.0, 0.0)},
        itself,
        lambda w, name, what: _watched(w, name, what),
    ),
    "Mechanism.part": Base(lambda w: {"name": "bar"}, itself, lambda w, name: w.mech.part(name)),
    "ground.at": Base(
        lambda w: {"x": 3.0, "y": 0.0}, _pinned, lambda w, x, y: w.mech.ground.at(x, y)
    ),
    "RigidBody.at": Base(lambda w: {"x": 1.0, "y": 0.0}, held, lambda w, x, y: w.bar.at(x, y)),
    "Beam.at": Base(lambda w: {"s": 0.5}, held, lambda w, s: w.beam.at(s)),
    "Beam.strain": Base(
        lambda w: {"s": 0.5, "offset": 1e-3}, observed, lambda w, **given: w.beam.strain(**given)
    ),
    "Beam.section_forces": Base(
        lambda w: {"s": 0.5}, observed, lambda w, s: w.beam.section_forces(s)
    ),
    "Beam.deformation": Base(
        lambda w: {"s": 0.5, "axes": "local"},
        observed,
        lambda w, **given: w.beam.deformation(**given),
    ),
    "equations_of_motion": Base(
        lambda w: {"mechanism": w.mech, "start": "as drawn"}, lambda w, e: w.run(e)
    ),
}
