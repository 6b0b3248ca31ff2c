"""Contacts of a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from beamdae.equations.equations_of_motion import EquationsOfMotion

if TYPE_CHECKING:
    from beamdae.parts.forces.contact import Contact


def contacts_of(equations: EquationsOfMotion) -> dict[str, Contact]:
    """Return the contacts of the mechanism by name, without an import if there are none."""
    parts = {} if equations.mechanism is None else equations.mechanism.parts
    if not any(part.gaps for part in parts.values()):
        return {}
    from beamdae.parts.forces.contact import Contact

    return {name: part for name, part in parts.items() if isinstance(part, Contact)}
