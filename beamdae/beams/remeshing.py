"""Copies of mechanisms in which beams have other meshes and formulations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property
from inspect import getattr_static
from typing import Any

import numpy as np

from beamdae.beams.beam import CUSTOM_FORMULATION, Beam, beams_of
from beamdae.beams.mesh import MIN_END_DISTANCE, Mesh
from beamdae.errors import BeamdaeError, format_exception, set_fields
from beamdae.parts.events import select_impacts
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.part import Part
from beamdae.symbolic.signal_pickling import copy_with_signals
from beamdae.symbolic.statements import Quantity

# Nodes per element of new meshes; elements with fewer nodes converge with a lower order.
_NODES = 4
# Curvature times element length in the coarsest mesh [rad]; half the value at which `Beam` warns
# about errors of 1 % in the compliance.
_MAX_TURN_PER_ELEMENT = 0.8
# Samples of the curvature along a beam.
_CURVATURE_SAMPLES = 65


@dataclass(frozen=True)
class BaseMesh:
    """Coarsest mesh of a beam; each finer mesh halves all elements.

    Attributes
    ----------
    beam
        The beam of the original mechanism.
    mesh
        The coarsest mesh.
    fixed_by
        Reason why the mesh and the formulation of the beam must not change, or an empty string.
    """

    beam: Beam
    mesh: Mesh
    fixed_by: str = ""

    @property
    def has_custom_kinematics(self) -> bool:
        """True if the beam has custom kinematics instead of a built-in formulation."""
        return self.beam.formulation == CUSTOM_FORMULATION

    def refined(self, halvings: int) -> Mesh:
        """Return the mesh with each element halved `halvings` times.

        The mesh is returned unchanged if `fixed_by` is set.
        """
        if self.fixed_by:
            return self.mesh
        count = 2**halvings
        if self.mesh.bounds is None:
            return replace(self.mesh, elements=self.mesh.elements * count)
        knots = np.linspace(0.0, self.mesh.elements, self.mesh.elements * count + 1)
        bounds = np.interp(knots, np.arange(self.mesh.elements + 1), self.mesh.bounds)
        return self.mesh.divided_at(bounds.tolist())


def choose_base_meshes(
    mechanism: Mechanism, elements: int, start: Any = None
) -> dict[str, BaseMesh]:
    """Return the coarsest mesh of each beam, by name.

    Elements end at the attachments, except for custom kinematics, for beams that must keep their
    mesh, and if too many elements would be necessary; see `Mesh.with_ends_at`.

    Parameters
    ----------
    mechanism
        The mechanism.
    elements
        Number of elements of a beam without attachments between its ends. A beam with fewer
        elements in the original mechanism keeps its number; a strongly curved beam may have more.
    start
        Start that replaces the start of the mechanism; None for the start of the mechanism. Beams
        whose coordinates the start names keep their meshes and formulations.
    """
    beams = {beam.name: beam for beam in beams_of(mechanism)}
    sections = attached_sections(mechanism)
    fixed = _fixed_beams(mechanism, beams, mechanism.start if start is None else start)
    meshes = {}
    for name, beam in beams.items():
        if id(beam) in fixed:
            meshes[name] = BaseMesh(beam, beam.mesh, fixed_by=fixed[id(beam)])
            continue
        count = max(min(elements, beam.mesh.elements), _elements_for_curvature(beam))
        is_custom = beam.formulation == CUSTOM_FORMULATION
        # Custom kinematics may assume equal elements with the number of nodes of the beam.
        uniform = (
            replace(beam.mesh, elements=count, bounds=None)
            if is_custom
            else Mesh(beam.curve, count, _NODES, "curved")
        )
        mesh = uniform if is_custom else uniform.with_ends_at(sorted(sections[id(beam)]))
        is_aligned = all(mesh.has_end_at(s, MIN_END_DISTANCE) for s in sections[id(beam)])
        if not is_aligned and not is_custom:
            # Bounds prevent the assembly from aligning only the finer meshes.
            mesh = uniform.divided_at(uniform.element_bounds.tolist())
        meshes[name] = BaseMesh(beam, mesh)
    return meshes


def with_meshes(
    mechanism: Mechanism, meshes: Mapping[str, Mesh], formulations: Mapping[str, str]
) -> Mechanism:
    """Return a copy of a mechanism with other meshes and formulations of beams.

    The original mechanism is not changed. Attachments, joints, loads, observables and events of the
    copy refer to the new beams. Beams whose meshes and formulations are not given are copied, too.
    The sections of `Beam.largest_stress` remain those of the original beams.

    Parameters
    ----------
    mechanism
        The mechanism.
    meshes
        Meshes of beams by name, see `Beam.with_mesh`.
    formulations
        Formulations of beams by name.

    Raises
    ------
    BeamdaeError
        If a part cannot be copied.
    """
    beams, sections = {}, attached_sections(mechanism)
    for name in {**meshes, **formulations}:
        beam = mechanism.parts[name]
        assert isinstance(beam, Beam)
        mesh, stress_mesh = meshes.get(name, beam.mesh), beam.divide_mesh(sections[id(beam)])
        beams[name] = beam.with_mesh(mesh, formulations.get(name), stress_mesh)
    return replace_beams(mechanism, beams, "with_meshes")


def replace_beams(
    mechanism: Mechanism,
    beams: Mapping[str, Beam],
    caller: str,
    alter: Callable[[Part], object] | None = None,
) -> Mechanism:
    """Return a copy of a mechanism with other beams on the same curves.

    See `with_meshes`. `caller` begins the message of an error, and `alter` may change values of the
    copied parts.

    Raises
    ------
    BeamdaeError
        If a part cannot be copied.
    """
    memo: dict[int, Any] = {id(mechanism.parts[name]): beam for name, beam in beams.items()}
    try:
        if mechanism.has_coordinate_signals:
            other = copy_with_signals(mechanism, memo)
        else:
            other = deepcopy(mechanism, memo)
    except Exception as problem:
        raise BeamdaeError(
            f"{caller}: a part of the mechanism cannot be copied "
            f"({format_exception(problem)}); keep objects that Python cannot copy, such as files "
            "and locks, in global variables."
        ) from problem
    for part in other.parts.values():
        if not isinstance(part, Beam):
            # Cached values may refer to the coordinates of the original mesh; the symbols of
            # states are parts of expressions.
            for name in set(vars(part)) - {"value_symbol"}:
                if isinstance(getattr_static(type(part), name, None), cached_property):
                    del vars(part)[name]
            if alter is not None:
                alter(part)
    # Warnings about the replaced beams concern their meshes and lengths.
    other.build_warnings = tuple(
        x
        for x in other.build_warnings
        if not x.startswith(tuple(f"{name}{end}" for name in beams for end in (": ", " (also ")))
    )
    other.observables = {name: x.current for name, x in other.observables.items()}
    for event in other.events:
        if isinstance(event.what, Quantity):
            set_fields(event, what=event.what.current)
        for impact in select_impacts(event.do):
            if isinstance(impact.on, Quantity):
                set_fields(impact, on=impact.on.current)
    return other


def attached_sections(mechanism: Mechanism) -> dict[int, set[float]]:
    """Return the arc lengths [m] of the attachments of each beam, by its `id`."""
    sections: dict[int, set[float]] = {id(beam): set() for beam in beams_of(mechanism)}
    for part in mechanism.parts.values():
        for attachment in part.attachments:
            if attachment.s is not None and id(attachment.body) in sections:
                sections[id(attachment.body)].add(float(attachment.s))
    return sections


def _fixed_beams(mechanism: Mechanism, beams: Mapping[str, Beam], start: Any) -> dict[int, str]:
    """Return the reasons why coordinates of beams must not change, by the `id` of the beam."""
    fixed = {
        id(piece.owner): f"the quantity {name!r} refers to its coordinates"
        for name, quantity in _named_quantities(mechanism)
        if not quantity.can_be_rebuilt
        for piece in quantity.pieces
        if isinstance(piece.owner, Beam)
    }
    if isinstance(start, Mapping):
        for name, beam in beams.items():
            if any(coordinate.startswith(f"{name}.") for coordinate in start):
                fixed[id(beam)] = "the start names its coordinates"
    return fixed


def _named_quantities(mechanism: Mechanism) -> Iterator[tuple[str, Quantity]]:
    yield from mechanism.observables.items()
    for event in mechanism.events:
        for quantity in (event.what, *(impact.on for impact in select_impacts(event.do))):
            if isinstance(quantity, Quantity):
                yield str(event.name), quantity


def _elements_for_curvature(beam: Beam) -> int:
    s = np.linspace(0.0, beam.length, _CURVATURE_SAMPLES)
    turn = float(np.max(np.abs(beam.curve.curvature(s)))) * beam.length
    return max(int(np.ceil(turn / _MAX_TURN_PER_ELEMENT)), 1)
