"""What is refused as a beam: sections that are none, and more elements than there is memory for."""

from __future__ import annotations

import numpy as np

from beamdae.beams.mesh import Mesh
from beamdae.beams.sections import Section
from beamdae.beams.varying_section import VaryingSection
from beamdae.errors import BeamdaeError
from beamdae.memory import available_memory, require_memory

# Radius of gyration over length: bending is lost in the rounding of stretching below, and nothing
# above is a beam.
_LEAST_GYRATION, _MOST_GYRATION = 1e-12, 1e2
# What a run takes at least for each element, whatever the integrator, times nodes less one [bytes].
# Measured: 95 to 150 kB, in long chains of beams and in a single one of 10 000 elements.
_MEMORY = 9e4


def require_slender(part: str, section: Section | VaryingSection, length: float) -> None:
    """Refuse a section that is none beside the length of the beam [m]."""
    for at in map(section.at, np.linspace(0.0, length, 3)):
        gyration = float(np.sqrt(at.second_moment / at.area))
        if not _LEAST_GYRATION <= gyration / length <= _MOST_GYRATION:
            raise BeamdaeError(
                f"{part}: second_moment {at.second_moment:g} m^4 and area {at.area:g} m^2 make a "
                f"radius of gyration of {gyration:.3g} m, it must be {_LEAST_GYRATION:g} to "
                f"{_MOST_GYRATION:g} times the length of {length:g} m."
            )


def require_room(part: str, mesh: Mesh) -> None:
    """Refuse more elements than there is memory for, before any of it is asked for."""
    each, there = _MEMORY * (mesh.nodes - 1), available_memory()
    if each * mesh.elements <= there:
        return
    most = int(there / each)
    remedy = f"take at most elements={most}"
    require_memory(part, f"a run of elements={mesh.elements}", each * mesh.elements, remedy)
