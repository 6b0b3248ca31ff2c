"""Equations of motion of a mechanism with halved elements of beams."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import beams_of
from beamdae.beams.prolongation import halve_elements, prolong_coordinates
from beamdae.beams.remeshing import choose_base_meshes, with_meshes
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError
from beamdae.parts.mechanism import AS_DRAWN, Mechanism

Array = np.ndarray


class HalvedElements(NamedTuple):
    """Mechanism whose beams with a built-in formulation have elements of half the length.

    Attributes
    ----------
    mechanism, equations
        The mechanism and its equations of motion.
    prolongation, start
        Coordinates `start` + `prolongation` @ q of the positions q of the original mechanism,
        (n', n) and (n',).
    """

    mechanism: Mechanism
    equations: EquationsOfMotion
    prolongation: sp.csc_array
    start: Array

    @classmethod
    def of(cls, equations: EquationsOfMotion) -> HalvedElements | None:
        """Return the mechanism of `equations` with halved elements.

        Returns None if no beam can be refined: there are none, the start names their coordinates,
        their kinematics are custom ones, or a part cannot be copied.
        """
        mechanism = equations.mechanism
        bases = {} if mechanism is None else choose_base_meshes(mechanism, 1)
        beams = {
            name: base.beam
            for name, base in bases.items()
            if not (base.fixed_by or base.has_custom_kinematics)
        }
        if mechanism is None or not beams:
            return None
        meshes = {name: halve_elements(beam.mesh) for name, beam in beams.items()}
        try:
            refined = with_meshes(mechanism, meshes, {})
            fine = equations_of_motion(refined, AS_DRAWN)
        except BeamdaeError:
            return None
        fine_beams = {beam.name: beam for beam in beams_of(refined)}
        pairs = {name: (beam, fine_beams[name]) for name, beam in beams.items()}
        return cls(refined, fine, *prolong_coordinates(equations.q_names, fine.q_names, pairs))
