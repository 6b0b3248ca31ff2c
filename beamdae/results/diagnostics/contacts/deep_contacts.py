"""Warnings about contacts whose penetration exceeds the thickness of a touching part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from beamdae.beams.beam import BeamAttachment
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.part_warnings import starts_in_equilibrium
from beamdae.equations.surface_gaps import compile_surface_gaps
from beamdae.errors import list_first
from beamdae.results.diagnostics.contacts.model_contacts import contacts_of, gaps_of_run
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.parts.forces.contact import Contact

Array = np.ndarray

_MAX_NAMES = 3  # of further contacts
_MIN_DEEPENING = 1.01  # depth relative to the one in the drawing


def deep_contact_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning about contacts that sink deeper than a touching part is thick.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    if not contacts_of(equations):
        return
    depths: dict[str, float] = {}
    for gap in compile_surface_gaps(equations):
        gaps = gaps_of_run(gap, trajectory)
        if not len(gaps):
            continue
        depth = -float(np.min(gaps))
        # Drawings may overlap by a preload, which has a warning if it is wrong.
        if starts_in_equilibrium(equations) or depth > -_MIN_DEEPENING * gaps[0]:
            depths[gap.part] = depth
    yield from _describe(equations, depths)


def deep_start_warnings(equations: EquationsOfMotion, time: Array, state: State) -> Iterator[str]:
    """Yield the warning of `deep_contact_warnings` about a start in equilibrium at (t, branch)."""
    if not (contacts_of(equations) and starts_in_equilibrium(equations)):
        return
    t, branch = time
    depths = {
        gap.part: -float(gap.evaluate(np.array([t]), branch, state.q[None])[0])
        for gap in compile_surface_gaps(equations)
    }
    yield from _describe(equations, depths)


def _describe(equations: EquationsOfMotion, depths: Mapping[str, float]) -> Iterator[str]:
    """Yield one warning about the contact that is deepest relative to the thickness."""
    deep = []
    for name, contact in contacts_of(equations).items():
        thickness, part = _thinnest_part(contact)
        if (depth := depths.get(name, 0.0)) > thickness:
            deep.append((depth / thickness, name, depth, thickness, part))
    if not deep:
        return
    (_, name, depth, thickness, part), *others = sorted(deep, reverse=True)
    also = f" (also {list_first([x[1] for x in others], _MAX_NAMES)})" if others else ""
    yield (
        f"{name}{also}: the contact sinks {depth:.3g} m deep, more than {part} "
        f"({thickness:.3g} m), and may have passed through; raise the stiffness if it does not "
        "stand for a soft layer."
    )


def _thinnest_part(contact: Contact) -> tuple[float, str]:
    """Return the smallest known thickness at a contact [m], and its description."""
    known = [
        (section.height, f"{x.body.name} is thick")
        for x in contact.attachments
        if isinstance(x, BeamAttachment) and x.s is not None
        for section in [x.body.section.at(x.s)]
        if section.height is not None
    ]
    return min(known, default=(np.inf, ""))
