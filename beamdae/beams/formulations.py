"""The formulations of a beam by name, and which settings each has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from beamdae.beams.exact.kinematics import GeometricallyExact
from beamdae.beams.floating_frame.kinematics import FloatingFrame
from beamdae.beams.kinematics import Kinematics, given_kinematics
from beamdae.beams.mesh import Mesh
from beamdae.errors import BeamdaeError, require_choice

FORMULATIONS: dict[str, type[FloatingFrame] | type[GeometricallyExact]] = {
    "floating frame": FloatingFrame,
    "exact": GeometricallyExact,
}


def made_kinematics(
    part: str,
    formulation: str,
    make: Callable[[str, Mesh, Any], Kinematics] | None,
    mesh: Mesh,
    section: Any,
    settings: Mapping[str, Any],
) -> Kinematics:
    """The kinematics of a formulation with these settings, or what `make` makes without any.

    Raises
    ------
    BeamdaeError
        If a setting belongs to another formulation.
    """
    require_choice(part, "formulation", formulation, tuple(FORMULATIONS))
    if make is not None:
        given = [*settings, *(["formulation"] if formulation != "floating frame" else [])]
        if given:
            raise BeamdaeError(
                f"{part}: {', '.join(given)} belong to beamdae's formulations, the kinematics "
                "given has settings of its own."
            )
        return given_kinematics(part, make, mesh, section)
    kind = FORMULATIONS[formulation]
    foreign = [name for name in settings if name not in {field.name for field in fields(kind)}]
    if foreign:
        raise BeamdaeError(
            f"{part}: {' and '.join(foreign)} belong to formulation='floating frame', leave them "
            f"out with {formulation!r}."
        )
    return kind(part, mesh, section, **settings)
