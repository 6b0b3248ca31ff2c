"""Equations of motion of a mechanism with more accurate beams."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.beams.beam import beams_of
from beamdae.beams.prolongation import halve_elements, prolong_coordinates
from beamdae.beams.remeshing import attached_sections, choose_base_meshes, replace_beams
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import BeamdaeError, hold_messages
from beamdae.parts.mechanism import AS_DRAWN, Mechanism

Array = np.ndarray


class RefinedBeams(NamedTuple):
    """Mechanism with exact strains or halved elements of some beams.

    Attributes
    ----------
    mechanism, equations
        The mechanism and its equations of motion.
    exact, halved
        Names of the beams with exact strains instead of others, and with halved elements.
    prolongation, start
        Coordinates `start` + `prolongation` @ q of the positions q of the original mechanism,
        (n', n) and (n',).
    """

    mechanism: Mechanism
    equations: EquationsOfMotion
    exact: tuple[str, ...]
    halved: tuple[str, ...]
    prolongation: sp.csc_array
    start: Array


def make_accurate(
    equations: EquationsOfMotion, exact: bool, halved: bool, start: Any
) -> RefinedBeams | None:
    """Return the mechanism whose floating-frame beams have exact strains, halved elements, or both.

    See `refine_beams`.
    """
    inexact = [x.statement.part for x in equations.ranges if x.statement.defect is not None]
    return refine_beams(
        equations,
        exact=inexact if exact else (),
        halved=None if halved else (),
        # Beams whose coordinates the start names keep their elements.
        start=start,
    )


def refine_beams(
    equations: EquationsOfMotion,
    *,
    exact: Collection[str] = (),
    halved: Collection[str] | None = None,
    start: Any = AS_DRAWN,
) -> RefinedBeams | None:
    """Return the mechanism with exact strains and halved elements of the named beams.

    Beams keep their elements and strains if the start names their coordinates, an observable or
    event refers to them, or their kinematics are custom ones. Geometrically exact beams keep their
    strains. Returns None if no beam differs, a part cannot be copied, or the start fails.

    Parameters
    ----------
    equations
        Equations of motion of the mechanism.
    exact
        Names of beams.
    halved
        Names of beams; None means all.
    start
        Start of the equations, see `Mechanism`.
    """
    mechanism = equations.mechanism
    if mechanism is None:
        return None
    beams, sections, strained = {}, attached_sections(mechanism), []
    try:
        for name, base in choose_base_meshes(mechanism, 1, start).items():
            if base.fixed_by or base.has_custom_kinematics:
                continue
            other = base.beam
            if name in exact:
                other = other.with_exact_strains()
                if other is not base.beam:
                    strained.append(name)
            if halved is None or name in halved:
                stress_mesh = base.beam.divide_mesh(sections[id(base.beam)])
                other = other.with_mesh(halve_elements(other.mesh), None, stress_mesh)
            if other is not base.beam:
                beams[name] = base.beam, other
        if not beams:
            return None
        others = {name: other for name, (_, other) in beams.items()}
        with hold_messages():  # Warnings about these beams do not concern the user.
            refined = replace_beams(mechanism, others, "refine_beams")
            finer = equations_of_motion(refined, start)
    except BeamdaeError:
        return None
    final = {beam.name: beam for beam in beams_of(refined)}
    pairs = {name: (beam, final[name]) for name, (beam, _) in beams.items()}
    return RefinedBeams(
        refined,
        finer,
        tuple(strained),
        tuple(name for name in beams if halved is None or name in halved),
        *prolong_coordinates(equations.q_names, finer.q_names, pairs),
    )
