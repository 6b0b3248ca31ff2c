"""Mechanisms in which everything that approximates is refined together."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import beams_of
from beamdae.beams.prolongation import prolong_coordinates
from beamdae.beams.remeshing import attached_sections, list_fixed_beams, replace_beams
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import hold_messages
from beamdae.parts.mechanism import AS_DRAWN
from beamdae.parts.part import Part

Array = np.ndarray

# Degrees that are added to chosen meshes: with three more, stated errors bound 94 to 100 % of the
# true ones, with two more 85 to 92 %.
_MORE_DEGREES = 3  # of chosen meshes
# Errors by the speed of regularized friction decrease in proportion to it: a tenth of it shows nine
# tenths of the error.
SPEED_RATIO = 0.1


class Refinement(NamedTuple):
    """Refined equations of motion.

    Attributes
    ----------
    equations
        The equations.
    halved, raised, exact, sharpened
        Names of the beams with halved elements, of those with elements of a higher degree, because
        the program chose their meshes, of those with exact strains instead of moderate ones, and of
        the parts with a tenth of their friction speed.
    kept
        Reasons why beams are not refined, by name.
    prolongation, start
        Coordinates `start` + `prolongation` @ q of the positions q of the original mechanism,
        (n', n) and (n',).
    """

    equations: EquationsOfMotion
    halved: tuple[str, ...]
    raised: tuple[str, ...]
    exact: tuple[str, ...]
    sharpened: tuple[str, ...]
    kept: dict[str, str]
    prolongation: sp.csc_array
    start: Array

    def prolong(self, q: Array) -> Array:
        """Return the coordinates (n',) or (n', k) of positions (n,) or (n, k)."""
        offset = self.start if q.ndim == 1 else self.start[:, None]
        return np.asarray(offset + self.prolongation @ q)


def refine(
    equations: EquationsOfMotion,
    start: Any = AS_DRAWN,
    *,
    strains: bool = True,
    friction: bool = True,
) -> Refinement | None:
    """Return the mechanism with finer meshes, exact strains and sharper friction.

    Beams keep their elements and strains if the start names their coordinates, an observable or
    event refers to them, or their kinematics are custom ones. Returns None if nothing is refined.

    Parameters
    ----------
    equations
        Equations of motion of the mechanism.
    start
        Start of the refined equations, see `Mechanism`.
    strains, friction
        False to keep the strains, or the friction speeds.

    Raises
    ------
    BeamdaeError
        If a part cannot be copied, or the start fails.
    """
    mechanism = equations.mechanism
    if mechanism is None:
        return None
    sections = attached_sections(mechanism)
    kept = list_fixed_beams(mechanism, start)
    beams = {x.name: x for x in beams_of(mechanism) if x.name not in kept}
    finer, halved, raised, exact = {}, [], [], []
    for name, beam in beams.items():
        other = beam.with_exact_strains() if strains else beam
        if other is not beam:
            exact.append(name)
        stress_mesh = beam.divide_mesh(sections[id(beam)])
        if beam.has_chosen_mesh:
            raised.append(name)
            mesh = beam.mesh.with_degree(beam.mesh.nodes - 1 + _MORE_DEGREES)
        else:
            halved.append(name)
            mesh = beam.mesh.with_divided_elements(2)
        finer[name] = other.with_mesh(mesh, stress_mesh)
    sharpened = []

    def sharpen(part: Part) -> None:
        if friction and part.sharpen_friction(SPEED_RATIO):
            sharpened.append(part.name)

    with hold_messages():  # Warnings about these beams do not concern the user.
        refined = replace_beams(mechanism, finer, "errors", sharpen)
        if not (finer or sharpened):
            return None
        refined_equations = equations_of_motion(refined, start)
    final = {beam.name: beam for beam in beams_of(refined)}
    pairs = {name: (beam, final[name]) for name, beam in beams.items()}
    names = equations.q_names, refined_equations.q_names
    prolongation, offset = prolong_coordinates(*names, pairs)
    return Refinement(
        refined_equations,
        tuple(halved),
        tuple(raised),
        tuple(exact),
        tuple(sharpened),
        kept,
        prolongation,
        offset,
    )
