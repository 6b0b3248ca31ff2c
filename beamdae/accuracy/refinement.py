"""Mechanisms in which everything that approximates is refined together."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.accuracy.errors import CAUSES, Refined
from beamdae.beams.beam import Beam
from beamdae.beams.mesh import Mesh
from beamdae.beams.remeshing import (
    divide_meshes,
    list_fixed_beams,
    prolong_coordinates,
    replace_beams,
)
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import hold_messages, set_fields
from beamdae.parts.mechanism import AS_DRAWN, Mechanism
from beamdae.parts.part import Part

Array = np.ndarray

# Degrees that are added to chosen meshes: with three more, stated errors bound 94 to 100 % of the
# true ones, with two more 85 to 92 %.
_MORE_DEGREES = 3
_MAX_DEGREE, _SPLIT_DEGREE = 12, 8  # beyond the first, halves of elements have the second
# Errors by the speed of regularized friction decrease in proportion to it: a tenth of it shows nine
# tenths of the error.
SPEED_RATIO = 0.1


class Refinement(NamedTuple):
    """Refined equations of motion.

    Attributes
    ----------
    equations
        The equations; the original ones if nothing is refined.
    refined
        What is refined.
    prolongation, start
        Coordinates `start` + `prolongation` @ q of the positions q of the original mechanism,
        (n', n) and (n',).
    """

    equations: EquationsOfMotion
    refined: Refined
    prolongation: sp.csc_array
    start: Array

    def prolong(self, q: Array) -> Array:
        """Return the coordinates (n',) or (n', k) of positions (n,) or (n, k)."""
        offset = self.start if q.ndim == 1 else self.start[:, None]
        return np.asarray(offset + self.prolongation @ q)


def _refine_mesh(beam: Beam, mesh: Mesh) -> Mesh:
    """Return a mesh with halved elements, or of a higher degree if the program chose the mesh."""
    if not beam._has_chosen_mesh:
        return mesh.with_divided_elements(2)
    degree = mesh.nodes - 1 + _MORE_DEGREES
    if degree <= _MAX_DEGREE:
        return mesh.with_degree(degree)
    return mesh.with_divided_elements(2).with_degree(_SPLIT_DEGREE)


def refine_mechanism(
    mechanism: Mechanism, start: Any = AS_DRAWN, causes: Collection[str] = CAUSES
) -> tuple[Mechanism, Refined]:
    """Return a copy with other meshes, exact strains and sharper friction, and what is refined.

    Strains are exact on refined meshes only. If neither meshes nor friction are refined, the
    mechanism itself is returned.

    Beams keep their elements and strains if the start names their coordinates, an observable or
    event refers to them, or their kinematics are custom ones.

    Parameters
    ----------
    mechanism
        The mechanism.
    start
        Its start, see `Mechanism`.
    causes
        Causes of errors that are reduced: "mesh", "theory" and "friction"; others are ignored.

    Raises
    ------
    BeamdaeError
        If a part cannot be copied.
    """
    if not {"mesh", "friction"}.intersection(causes):
        return mechanism, Refined()
    kept = list_fixed_beams(mechanism, start)
    elements, degrees, finer, inexact = {}, {}, {}, []
    for beam, mesh in divide_meshes(mechanism, kept) if "mesh" in causes else ():
        other = beam._with_exact_strains() if "theory" in causes else beam
        if other is not beam:
            inexact.append(beam.name)
        if beam._has_chosen_mesh:
            degrees[beam.name] = mesh.nodes - 1
        else:
            elements[beam.name] = mesh.elements
        finer[beam.name] = other._with_mesh(_refine_mesh(beam, mesh), mesh)
    sharpened = []

    def sharpen(part: Part) -> None:
        if "friction" in causes and part.regularized_friction is not None:
            speed = SPEED_RATIO * part.regularized_friction.speed
            set_fields(part, friction_speed=speed)
            sharpened.append(part.name)

    with hold_messages():  # Warnings about these beams do not concern the user.
        copy = replace_beams(mechanism, finer, "errors", sharpen)
    return copy, Refined(elements, degrees, tuple(inexact), tuple(sharpened), kept=kept)


def refine(
    equations: EquationsOfMotion, start: Any = AS_DRAWN, causes: Collection[str] = CAUSES
) -> Refinement:
    """Return equations with finer meshes, exact strains and sharper friction.

    Parameters
    ----------
    equations
        Equations of motion of the mechanism.
    start
        Start of the refined equations, see `Mechanism`.
    causes
        See `refine_mechanism`.

    Raises
    ------
    BeamdaeError
        If a part cannot be copied, or the start fails.
    """
    mechanism, refined = equations.mechanism, Refined()
    if mechanism is not None:
        other, refined = refine_mechanism(mechanism, start, causes)
    if mechanism is None or not refined.causes:
        identity = sp.eye_array(equations.n, format="csc")
        return Refinement(equations, refined, identity, np.zeros(equations.n))
    with hold_messages():
        refined_equations = equations_of_motion(other, start)
    names = equations.q_names, refined_equations.q_names
    prolongation, offset = prolong_coordinates(*names, mechanism.parts, other.parts)
    return Refinement(refined_equations, refined, prolongation, offset)
