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


def _beam(world: World) -> dict[str, Any]:
    return {
        "name": "beam",
        "curve": bd.Line((0.0, 1.0), (1.0, 1.0)),
        "section": world.section,
        "elements": 1,
        "strain": "green",
        "formulation": "floating frame",
        "elements_shape": "curved",
        "continuity": "cartesian",
        "nodes": 4,
        "quadrature": "reduced",
        "frame": "chord",
        "velocity": (0.0, 0.0),
        "angular_velocity": 0.0,
        "kinematics": None,
        "free_curve": bd.Line((0.0, 0.0), (1.0, 0.0)),
    }


def _section(world: World) -> dict[str, Any]:
    return {
        "material": world.material,
        "area": 8e-5,
        "second_moment": 1e-10,
        "shear_coefficient": 0.8,
        "damping": 1e-5,
        "mass_per_length": 0.6,
        "rotary_inertia_per_length": 1e-6,
        "shear_peak": 1.5,
    }


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


PARTS: dict[str, Base] = {
    "AirDrag": Base(lambda w: {"name": "drag", "beam": w.beam, "coefficient": 0.1}, added),
    "Attachment": Base(_attachment, held),
    "Beam": Base(_beam, added),
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
    "Force": Base(
        lambda w: {"name": "load", "on": w.bar.at(*KNEE), "law": (1.0, 0.0), "axes": "body"}, added
    ),
    "Moment": Base(lambda w: {"name": "load", "on": w.bar.at(*KNEE), "law": 1.0}, added),
    "Part": Base(_members, added, _extended),
    "PointMass": Base(
        lambda w: {"name": "mass", "mass": 0.1, "at": (2.0, 0.0), "velocity": (0.0, 0.0)},
        added,
    ),
    "PointMass on": Base(
        lambda w: {"name": "mass", "mass": 0.1, "on": w.bar.at(*KNEE)},
        added,
    ),
    "RayleighDamping": Base(
        lambda w: {"name": "oil", "beam": w.beam, "mass": 0.1, "stiffness": 1e-5}, added
    ),
    "RigidBody": Base(
        lambda w: {
            "name": "disk",
            "mass": 1.0,
            "inertia": 0.1,
            "center": (3.0, 0.0),
            "velocity": (0.0, 0.0),
            "angular_velocity": 0.0,
            "shape": ((2.9, 0.0), (3.1, 0.0), (3.0, 0.1)),
        },
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
    "Arc": Base(lambda w: {"radius": 1.0, "length": 1.0, "start": (0.0, 1.0), "angle": 0.0}, bent),
    "Curve": Base(
        lambda w: {"function": lambda x: 0.1 * x**2, "x": (0.0, 1.0)},
        bent,
    ),
    "Curve of points": Base(
        lambda w: {"points": [(0.0, 0.0), (1.0, 0.1), (2.0, 0.1), (3.0, 0.0)], "noise": 1e-3},
        bent,
    ),
    "IntrinsicCurve": Base(
        lambda w: {"law": lambda s: 0.1 * s, "length": 1.0, "start": (0.0, 1.0), "angle": 0.0},
        bent,
    ),
    "Line": Base(lambda w: {"start": (0.0, 1.0), "end": (1.0, 1.0)}, bent),
    "Parabola": Base(lambda w: {"span": 1.0, "rise": 0.1, "start": (0.0, 1.0), "angle": 0.0}, bent),
    "Segment": Base(
        lambda w: {"curve": bd.Arc(1.0, 1.0, (0.0, 1.0)), "start": 0.2, "end": 0.8}, bent
    ),
    "Material": Base(
        lambda w: {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "yield_stress": 235e6},
        lambda w, material: made_of(w, bd.Section(material, 8e-5, 1e-10)),
    ),
    "Section": Base(_section, made_of),
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
    "taper": Base(
        lambda w: {"shape": bd.Section.circle, "material": w.material, "diameter": (0.01, 0.02)},
        made_of,
    ),
    "Law": Base(
        lambda w: {
            "pieces": (lambda t: t, lambda t: 0.0),
            "breakpoints": (0.005,),
            "time_scale": 1.0,
        },
        loaded,
    ),
    "piecewise": Base(
        lambda w: {"end": 0.005, "law": 1.0, "last": 0.0},
        loaded,
        lambda w, end, law, last: bd.piecewise((end, law), last),
    ),
    "piecewise entry": Base(
        lambda w: {"piece": (0.005, 1.0)}, loaded, lambda w, piece: bd.piecewise(piece, 0.0)
    ),
    "run_up": Base(lambda w: {"speed": 1.0, "duration": 0.1}, loaded),
    "sine": Base(lambda w: {"amplitude": 1.0, "frequency": 50.0, "phase": 0.0}, loaded),
    "table": Base(
        lambda w: {"times": [0.0, 0.004, 0.01, 0.02], "values": [0.0, 1.0, 0.0, 1.0]}, loaded
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
    "relative_displacement": Base(
        lambda w: {"of": w.bar.at(*KNEE), "on": w.bar.at(0.0, 0.0)}, observed
    ),
    "equations_of_motion": Base(
        lambda w: {"mechanism": w.mech, "start": "as drawn"}, lambda w, e: w.run(e)
    ),
}
