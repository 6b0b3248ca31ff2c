"""Equilibria of the structures in `static_systems` in Exudyn 1.13 or later (`pip install exudyn`).

A worker that reads runs from standard input (`measurement.start_exudyn`). Elements are
geometrically exact and have 2 nodes. Newton's method computes a new matrix in each iteration, load
steps are adaptive, one thread is used, and no files are written.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from exudyn_peer import answer_jobs, exd, exu
from static_systems import (
    POISSON,
    RHO,
    SHEAR_FACTOR,
    STRUCTURES,
    WIDTH,
    E,
    Segment,
    Structure,
)

RELATIVE_TOLERANCE = 1e-8
ABSOLUTE_TOLERANCE = 1e-8


def build_structure(structure: Structure, elements: int) -> tuple[Any, int]:
    """Return the assembled system, and the node of the load."""
    mbs = exu.SystemContainer().AddSystem()
    area, bending = WIDTH * structure.height, structure.bending_stiffness
    section = {
        "massPerLength": RHO * area,
        "crossSectionInertia": RHO * WIDTH * structure.height**3 / 12.0,
        "bendingStiffness": bending,
        "axialStiffness": E * area,
        "shearStiffness": SHEAR_FACTOR * E / (2.0 * (1.0 + POISSON)) * area,
    }
    nodes: list[int] = []
    last: list[int] = []
    beams: list[int] = []
    for segment in structure.segments:
        last = _add_segment(mbs, segment, elements, section, beams)
        if nodes:
            # Sections of both beams at a corner turn together.
            axes = [1, 1, 0, 0, 0, 1]
            _join(mbs, nodes[-1], last[0], axes, structure.segments[0].angle - segment.angle)
        nodes += last
    ground = mbs.AddObject(exd.ObjectGround())
    first, end = structure.segments[0], structure.segments[-1]
    _support(mbs, ground, first.start, first.angle, nodes[0], [1, 1, 0, 0, 0, 1])
    if structure.is_hinged:
        _support(mbs, ground, end.point(end.length), 0.0, nodes[-1], [1, 1, 0, 0, 0, 0])
    loaded = last[round(structure.loaded * elements)]
    marker = mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=loaded))
    force = [bending * component for component in structure.force]
    if any(force):
        mbs.AddLoad(exd.LoadForceVector(markerNumber=marker, loadVector=[*force, 0.0]))
    if structure.moment:
        torque = [0.0, 0.0, structure.moment * bending]
        mbs.AddLoad(exd.LoadTorqueVector(markerNumber=marker, loadVector=torque))
    for beam in beams if structure.gravity else ():
        mass = mbs.AddMarker(exd.MarkerBodyMass(bodyNumber=beam))
        weight = [0.0, -structure.gravity, 0.0]
        mbs.AddLoad(exd.LoadMassProportional(markerNumber=mass, loadVector=weight))
    mbs.Assemble()
    return mbs, loaded


def _add_segment(
    mbs: Any, segment: Segment, elements: int, section: dict[str, float], beams: list[int]
) -> list[int]:
    """Add the elements of a segment to `beams`; return its nodes."""
    lengths = np.linspace(0.0, segment.length, elements + 1)
    nodes = [
        mbs.AddNode(
            exd.NodeRigidBody2D(
                referenceCoordinates=[*segment.point(s), segment.angle + segment.curvature * s]
            )
        )
        for s in lengths.tolist()
    ]
    chord = float(np.hypot(*np.subtract(segment.point(lengths[1]), segment.point(0.0))))
    for k in range(elements):
        element = exd.ObjectBeamGeometricallyExact2D(
            nodeNumbers=[nodes[k], nodes[k + 1]],
            length=chord,
            referenceCurvature=segment.curvature * lengths[1] / chord,
            includeReferenceRotations=True,
            **section,
        )
        beams.append(mbs.AddObject(element))
    return nodes


def _join(mbs: Any, one: int, other: int, axes: list[int], angle: float) -> None:
    """Join two nodes; `angle` is that of the first one relative to the other."""
    turned = exu.HT(rotation=exd.RotationMatrixZ(angle), translation=[0.0, 0.0, 0.0])
    markers = [
        mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=one)),
        mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=other, localHT=turned)),
    ]
    mbs.AddObject(exd.GenericJoint(markerNumbers=markers, constrainedAxes=axes))


def _support(
    mbs: Any, ground: int, point: tuple[float, float], angle: float, node: int, axes: list[int]
) -> None:
    place = exu.HT(rotation=exd.RotationMatrixZ(angle), translation=[*point, 0.0])
    markers = [
        mbs.AddMarker(exd.MarkerBodyRigid(bodyNumber=ground, localHT=place)),
        mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=node)),
    ]
    mbs.AddObject(exd.GenericJoint(markerNumbers=markers, constrainedAxes=axes))


def time_run(system: str, elements: int, steps: int) -> dict[str, Any]:
    """Return processor times of building and solution [s], counts, and the loaded point."""
    begin = time.process_time()
    mbs, loaded = build_structure(STRUCTURES[system], elements)
    settings = exu.SimulationSettings()
    static = settings.staticSolver
    static.numberOfLoadSteps, static.verboseMode, static.adaptiveStep = steps, 0, True
    static.newton.useModifiedNewton = False
    static.newton.relativeTolerance = RELATIVE_TOLERANCE
    static.newton.absoluteTolerance = ABSOLUTE_TOLERANCE
    settings.solution.file.write = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.parallel.numberOfThreads = 1
    built = time.process_time()
    try:
        success = bool(mbs.SolveStatic(settings))
    except Exception:
        success = False
    solved = time.process_time()
    counts = mbs.sys["staticSolver"].it
    position = mbs.GetNodeOutput(loaded, exu.OutputVariableType.Position)
    return {
        "build": built - begin,
        "solve": solved - built,
        "success": success,
        "unknowns": len(mbs.systemData.GetODE2Coordinates()),
        "steps": counts.currentStepIndex - 1,
        "newton": counts.newtonStepsCount,
        "point": [float(x) for x in position[:2]],
    }


if __name__ == "__main__":
    answer_jobs(time_run)
