"""Mechanisms in which everything that approximates is refined together."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import Beam
from beamdae.beams.mesh import Mesh
from beamdae.beams.prolongation import prolong_coordinates
from beamdae.beams.remeshing import divide_meshes, list_fixed_beams, replace_beams
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import hold_messages
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


class RefinedMechanism(NamedTuple):
    """Copy of a mechanism with refined parts.

    Attributes
    ----------
    mechanism
        The copy.
    remeshed
        The original beams of those with another mesh, by name.
    exact, sharpened
        Names of the beams with exact strains instead of moderate ones, and of the parts with
        smaller friction speeds.
    kept
        Reasons why beams are not refined, by name.
    """

    mechanism: Mechanism
    remeshed: dict[str, Beam]
    exact: tuple[str, ...]
    sharpened: tuple[str, ...]
    kept: dict[str, str]

    @property
    def raised(self) -> tuple[str, ...]:
        """Names of the beams with elements of a higher degree, because the mesh was chosen."""
        return tuple(name for name, beam in self.remeshed.items() if beam.has_chosen_mesh)

    @property
    def halved(self) -> tuple[str, ...]:
        """Names of the beams with halved elements."""
        return tuple(name for name in self.remeshed if name not in self.raised)


def refine_mesh(beam: Beam, mesh: Mesh) -> Mesh:
    """Return a mesh with halved elements, or of a higher degree if the program chose the mesh."""
    if not beam.has_chosen_mesh:
        return mesh.with_divided_elements(2)
    degree = mesh.nodes - 1 + _MORE_DEGREES
    if degree <= _MAX_DEGREE:
        return mesh.with_degree(degree)
    return mesh.with_divided_elements(2).with_degree(_SPLIT_DEGREE)


def refine_mechanism(
    mechanism: Mechanism,
    start: Any = AS_DRAWN,
    change_mesh: Callable[[Beam, Mesh], Mesh] = refine_mesh,
    *,
    strains: bool = True,
    friction: bool = True,
) -> RefinedMechanism | None:
    """Return a copy with other meshes, exact strains and sharper friction; None without any.

    Beams keep their elements and strains if the start names their coordinates, an observable or
    event refers to them, or their kinematics are custom ones.

    Parameters
    ----------
    mechanism
        The mechanism.
    start
        Its start, see `Mechanism`.
    change_mesh
        Function of a beam and of its mesh, after its first assembly, that returns the mesh of the
        copy.
    strains, friction
        False to keep the strains, or the friction speeds.

    Raises
    ------
    BeamdaeError
        If a part cannot be copied.
    """
    kept = list_fixed_beams(mechanism, start)
    beams, finer, exact = {}, {}, []
    for beam, mesh in divide_meshes(mechanism, kept):
        other = beam.with_exact_strains() if strains else beam
        if other is not beam:
            exact.append(beam.name)
        beams[beam.name] = beam
        finer[beam.name] = other.with_mesh(change_mesh(beam, mesh), mesh)
    sharpened = []

    def sharpen(part: Part) -> None:
        if friction and part.sharpen_friction(SPEED_RATIO):
            sharpened.append(part.name)

    with hold_messages():  # Warnings about these beams do not concern the user.
        copy = replace_beams(mechanism, finer, "errors", sharpen)
    if not (finer or sharpened):
        return None
    return RefinedMechanism(copy, beams, tuple(exact), tuple(sharpened), kept)


def refine(
    equations: EquationsOfMotion,
    start: Any = AS_DRAWN,
    *,
    strains: bool = True,
    friction: bool = True,
) -> Refinement | None:
    """Return equations with finer meshes, exact strains and sharper friction.

    Returns None if nothing is refined; see `refine_mechanism`.

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
    refined = refine_mechanism(mechanism, start, strains=strains, friction=friction)
    if refined is None:
        return None
    with hold_messages():
        refined_equations = equations_of_motion(refined.mechanism, start)
    names = equations.q_names, refined_equations.q_names
    parts = mechanism.parts, refined.mechanism.parts
    prolongation, offset = prolong_coordinates(*names, *parts)
    of_beams = refined.halved, refined.raised, *refined[2:]
    return Refinement(refined_equations, *of_beams, prolongation, offset)
