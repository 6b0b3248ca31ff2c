"""Working calls of parts, curves, sections and laws: samples of the catalog, and variants."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import beamdae as bd
from beamdae import catalog
from robustness.world import Base, World, added, bent, itself, loaded, made_of, observed

# What is done with the result of a call, by heading or page of the reference, and exceptions.
_USES: dict[str, Callable[[World, Any], Any]] = {
    "Bodies": added,
    "Joints": added,
    "Drivers": added,
    "Loads and forces": added,
    "Laws of time": loaded,
    "Observables": observed,
    "beams": bent,
    "sections": made_of,
}
_OTHER_USES: dict[str, Callable[[World, Any], Any]] = {
    "Beam": added,
    "CircleSurface": itself,
    "LineSurface": itself,
    "Material": lambda world, material: made_of(world, bd.Section(material, 8e-5, 1e-10)),
    "positive_part": itself,
    "smooth_sign": itself,
}


def _guide(world: World) -> bd.PointOnLine:
    slider = world.mech.add(bd.RigidBody("slider", 1.0, 0.1, (3.0, 0.0)))
    ends = world.mech.ground.at(3.0, 0.0), slider.at(3.0, 0.0)
    return world.mech.add(bd.PointOnLine("rail", *ends, direction=(1.0, 0.0)))


def _with_law(world: World, **law: Any) -> dict[str, Any]:
    ends = {"a": world.ground.at(1.1, 0.2), "b": world.disk.at(0.1, 0.2)}
    return {"name": "spring"} | ends | law


def _force(x: Any, rate: Any) -> Any:
    return 2.0 * x + 0.1 * rate


def _energy(x: Any) -> Any:
    return x**2


def _bushing_force(x: Any, rate: Any) -> Any:
    return (2.0 * x[0], x[1], x[2])


def _bushing_energy(x: Any) -> Any:
    return x[0] ** 2 + 0.5 * x[1] ** 2 + 0.5 * x[2] ** 2


PARTS: dict[str, Base] = {
    public.name: Base(
        public.sample, _OTHER_USES.get(public.name) or _USES[group.heading or group.page]
    )
    for group in catalog.GROUPS
    for public in group.names
    if public.sample
} | {
    "Friction in a guide": Base(
        lambda w: {
            "name": "friction",
            "joint": _guide(w),
            "coefficient": 0.2,
            "regularization": 0.1,
        },
        added,
    ),
    "Bushing of a law": Base(
        lambda w: _with_law(w, law=_bushing_force, energy=_bushing_energy),
        added,
        lambda w, **arguments: bd.Bushing(**arguments),
    ),
    "Damper of a law": Base(
        lambda w: _with_law(w, law=_force), added, lambda w, **arguments: bd.Damper(**arguments)
    ),
    "Spring of a law": Base(
        lambda w: _with_law(w, law=_force, energy=_energy),
        added,
        lambda w, **arguments: bd.Spring(**arguments),
    ),
    "SpringDamper of a law": Base(
        lambda w: _with_law(w, law=_force, energy=_energy),
        added,
        lambda w, **arguments: bd.SpringDamper(**arguments),
    ),
    "TorsionDamper of a law": Base(
        lambda w: _with_law(w, law=_force),
        added,
        lambda w, **arguments: bd.TorsionDamper(**arguments),
    ),
    "TorsionSpring of a law": Base(
        lambda w: _with_law(w, law=_force, energy=_energy),
        added,
        lambda w, **arguments: bd.TorsionSpring(**arguments),
    ),
}
