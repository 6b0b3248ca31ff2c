"""Hub beam, pendulum, and equilibria of structures in Exudyn 1.13 or later (`pip install exudyn`).

    python validation/performance/exudyn_peer.py '{"system": "hub beam", "elements": 8}'

prints times, counts and the path of the tip, or the loaded point of a structure of
`static_systems`. Without an argument, the script is a worker that reads such runs from standard
input, one per line (`measurement.start_exudyn`).

Beams consist of geometrically exact 2D elements of 2 or 3 nodes, curved and free of stress at the
start. The torque is a symbolic function. Runs use one thread, write no files and reuse
factorizations (modified Newton); equilibria use a new matrix in each iteration.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import time
from itertools import pairwise
from typing import Any

import numpy as np
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

# Import the module without range checks, which prints a note.
sys.exudynFast = True
with contextlib.redirect_stdout(io.StringIO()):
    import exudyn as exu
    from exudyn import utilities as exd

RELATIVE_TOLERANCE = 1e-8
STATIC_TOLERANCE = 1e-8  # of residuals of equilibria
_WELD, _HINGE = [1, 1, 0, 0, 0, 1], [1, 1, 0, 0, 0, 0]  # constrained axes


def add_beam(
    mbs: Any, segment: Segment, section: dict[str, float], elements: int, nodes: int = 2
) -> tuple[list[int], list[int]]:
    """Add elements of 2 or 3 nodes; return the nodes at their ends, and the elements."""
    lengths = np.linspace(0.0, segment.length, elements + 1).tolist()
    ends = [
        _add_node(mbs, segment.point(s), segment.angle + segment.curvature * s) for s in lengths
    ]
    half = 0.5 * segment.curvature * lengths[1]
    length = chord = float(np.hypot(*np.subtract(segment.point(lengths[1]), segment.start)))
    sag = 0.0
    if nodes == 3:
        # Quadratic axis whose tangents at both Gauss points are those of the arc.
        gauss = 1.0 / np.sqrt(3.0)
        sag = chord * np.tan(gauss * half) / (4.0 * gauss)
        length = 2.0 * np.hypot(0.5 * chord, 2.0 * sag * gauss)
    added = []
    for k, (a, b) in enumerate(pairwise(lengths)):
        element_nodes = [ends[k], ends[k + 1]]
        if nodes == 3:
            middle = segment.angle + segment.curvature * a + half
            between = 0.5 * np.add(segment.point(a), segment.point(b))
            point = between - sag * np.array([-np.sin(middle), np.cos(middle)])
            element_nodes.insert(1, _add_node(mbs, point.tolist(), middle))
        element = exd.ObjectBeamGeometricallyExact2D(
            nodeNumbers=element_nodes,
            length=length,
            referenceCurvature=2.0 * half / length,
            includeReferenceRotations=True,
            **section,
        )
        added.append(mbs.AddObject(element))
    return ends, added


def _add_node(mbs: Any, point: Any, angle: float) -> int:
    return mbs.AddNode(exd.NodeRigidBody2D(referenceCoordinates=[*point, float(angle)]))


def _add_weight(mbs: Any, elements: list[int], gravity: float) -> None:
    for element in elements:
        marker = mbs.AddMarker(exd.MarkerBodyMass(bodyNumber=element))
        load = exd.LoadMassProportional(markerNumber=marker, loadVector=[0.0, -gravity, 0.0])
        mbs.AddLoad(load)


def section_properties(
    E: float, rho: float, area: float, inertia: float, damping: float
) -> dict[str, float]:
    """Return stiffness, mass and Kelvin-Voigt damping."""
    stiffness = {
        "bending": E * inertia,
        "axial": E * area,
        "shear": SHEAR_FACTOR * E / (2.0 * (1.0 + POISSON)) * area,
    }
    return {
        "massPerLength": rho * area,
        "crossSectionInertia": rho * inertia,
        **{f"{kind}Stiffness": value for kind, value in stiffness.items()},
        **{f"{kind}Damping": damping * value for kind, value in stiffness.items()},
    }


def add_hub_beam(mbs: Any, elements: int, nodes: int, damping: float) -> int:
    """Add the beam on a hub with a torque; return the node of its tip."""
    arc = Segment((0.05, 0.0), 0.0, 5.0 * np.pi / 3.0, 1.0 / 5.0)
    section = section_properties(68.952e9, 2766.7, 8e-5, 1.06667e-8, damping)
    ends, _ = add_beam(mbs, arc, section, elements, nodes)
    node = _add_node(mbs, [0.0, 0.0], 0.0)
    hub = mbs.AddObject(exd.ObjectRigidBody2D(mass=1.0, inertia=0.3, nodeNumber=node))
    ground = mbs.AddMarker(exd.MarkerBodyPosition(bodyNumber=mbs.AddObject(exd.ObjectGround())))
    center = mbs.AddMarker(exd.MarkerBodyPosition(bodyNumber=hub))
    mbs.AddObject(exd.RevoluteJoint2D(markerNumbers=[ground, center]))
    rim = mbs.AddMarker(exd.MarkerBodyRigid(bodyNumber=hub, localPosition=[0.05, 0.0, 0.0]))
    root = mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=ends[0]))
    mbs.AddObject(exd.GenericJoint(markerNumbers=[rim, root], constrainedAxes=_WELD))

    def torque(mbs: Any, t: float, load: Any) -> list[Any]:
        return [0.0, 0.0, 10.0 * exu.symbolic.sin(2.0 * np.pi * t)]

    turned = mbs.AddMarker(exd.MarkerBodyRigid(bodyNumber=hub))
    load = mbs.AddLoad(exd.LoadTorqueVector(markerNumber=turned, loadVector=[0.0, 0.0, 10.0]))
    name = "loadVectorUserFunction"
    mbs.SetLoadParameter(load, name, torque)
    mbs.SetLoadParameter(load, name, exd.CreateSymbolicUserFunction(mbs, torque, name, load))
    return ends[-1]


def add_pendulum(mbs: Any, elements: int, nodes: int, damping: float) -> int:
    """Add the hanging beam with a tip mass; return the node of its tip."""
    area, gravity, mass = 0.03 * 0.0025, 9.81, 0.060
    arc = Segment((0.0, 0.0), -0.60, 0.80, 1.0 / 0.85)
    strip = section_properties(68.95e9, 2760.0, area, area * 0.0025**2 / 12.0, damping)
    ends, added = add_beam(mbs, arc, strip, elements, nodes)
    _add_weight(mbs, added, gravity)
    ground = mbs.AddMarker(exd.MarkerBodyPosition(bodyNumber=mbs.AddObject(exd.ObjectGround())))
    root = mbs.AddMarker(exd.MarkerNodePosition(nodeNumber=ends[0]))
    mbs.AddObject(exd.RevoluteJoint2D(markerNumbers=[ground, root]))
    tip = exd.ObjectGenericODE2(
        nodeNumbers=[ends[-1]],
        massMatrix=np.diag([mass, mass, 0.0]),
        forceVector=np.array([0.0, -mass * gravity, 0.0]),
    )
    mbs.AddObject(tip)
    return ends[-1]


def add_structure(mbs: Any, structure: Structure, elements: int) -> int:
    """Add a structure and its load; return the node of the load."""
    bending = structure.bending_stiffness
    area, inertia = WIDTH * structure.height, WIDTH * structure.height**3 / 12.0
    section = section_properties(E, RHO, area, inertia, 0.0)
    first, end = structure.segments[0], structure.segments[-1]
    ground = mbs.AddObject(exd.ObjectGround())

    def support(point: tuple[float, float], angle: float, node: int, axes: list[int]) -> None:
        place = exu.HT(rotation=exd.RotationMatrixZ(angle), translation=[*point, 0.0])
        fixed = mbs.AddMarker(exd.MarkerBodyRigid(bodyNumber=ground, localHT=place))
        moved = mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=node))
        mbs.AddObject(exd.GenericJoint(markerNumbers=[fixed, moved], constrainedAxes=axes))

    ends: list[int] = []
    for segment in structure.segments:
        before = ends
        ends, added = add_beam(mbs, segment, section, elements)
        _add_weight(mbs, added if structure.gravity else [], structure.gravity)
        if not before:
            support(first.start, first.angle, ends[0], _WELD)
            continue
        # Sections of both beams at a corner turn together.
        rotation = exd.RotationMatrixZ(first.angle - segment.angle)
        turned = exu.HT(rotation=rotation, translation=[0.0, 0.0, 0.0])
        one = mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=before[-1]))
        other = mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=ends[0], localHT=turned))
        mbs.AddObject(exd.GenericJoint(markerNumbers=[one, other], constrainedAxes=_WELD))
    if structure.is_hinged:
        support(end.point(end.length), 0.0, ends[-1], _HINGE)
    loaded = ends[round(structure.loaded * elements)]
    marker = mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=loaded))
    force = [bending * component for component in structure.force]
    if any(force):
        mbs.AddLoad(exd.LoadForceVector(markerNumber=marker, loadVector=[*force, 0.0]))
    if structure.moment:
        torque = [0.0, 0.0, structure.moment * bending]
        mbs.AddLoad(exd.LoadTorqueVector(markerNumber=marker, loadVector=torque))
    return loaded


# Model, end time [s], and absolute tolerance of Newton's residual.
SYSTEMS = {"hub beam": (add_hub_beam, 2.0, 1e-6), "pendulum": (add_pendulum, 5.0, 1e-5)}


def time_run(
    system: str,
    elements: int = 8,
    nodes: int = 3,
    step: float = 1e-3,
    damping: float = 0.0,
    end: float | None = None,
    rho_inf: float = 0.9,
    tolerance: float | None = None,
    path: bool = True,
) -> dict[str, Any]:
    """Return processor times of building and integration [s], counts, and the path of the tip."""
    model, t_end, allowed = SYSTEMS[system]
    t_end, allowed = end or t_end, tolerance or allowed
    begin = time.process_time()
    mbs = exu.SystemContainer().AddSystem()
    tip = model(mbs, elements, nodes, damping)
    position = exd.SensorNode(
        nodeNumber=tip, storeInternal=True, outputVariableType=exu.OutputVariableType.Position
    )
    sensor = mbs.AddSensor(position)
    mbs.Assemble()
    settings = _common_settings()
    settings.solution.sensors.writePeriod = 0.01
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = round(t_end / step), t_end
    integration.verboseMode = 0
    integration.generalizedAlpha.spectralRadius = rho_inf
    integration.newton.useModifiedNewton = True
    integration.newton.relativeTolerance = RELATIVE_TOLERANCE
    integration.newton.absoluteTolerance = allowed
    built = time.process_time()
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.GeneralizedAlpha)
    solved = time.process_time()
    rows = np.asarray(mbs.GetSensorStoredData(sensor))[:, :3]
    counts = mbs.sys["dynamicSolver"].it
    return {
        "build": built - begin,
        "integrate": solved - built,
        "unknowns": len(mbs.systemData.GetODE2Coordinates()),
        "steps": counts.currentStepIndex,
        "newton": counts.newtonStepsCount,
        "jacobians": counts.newtonJacobiCount,
        "path": np.unique(rows, axis=0).tolist() if path else [],
    }


def time_equilibrium(system: str, elements: int, steps: int) -> dict[str, Any]:
    """Return processor times of building and solution [s], counts, and the loaded point."""
    begin = time.process_time()
    mbs = exu.SystemContainer().AddSystem()
    loaded = add_structure(mbs, STRUCTURES[system], elements)
    mbs.Assemble()
    settings = _common_settings()
    static = settings.staticSolver
    static.numberOfLoadSteps, static.verboseMode, static.adaptiveStep = steps, 0, True
    static.newton.useModifiedNewton = False
    static.newton.relativeTolerance = RELATIVE_TOLERANCE
    static.newton.absoluteTolerance = STATIC_TOLERANCE
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


def _common_settings() -> Any:
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.parallel.numberOfThreads = 1
    return settings


def answer_jobs() -> None:
    """Answer the jobs in the arguments or, without arguments, in the lines of standard input."""
    # Output of the library goes to standard error, so that answers are the only output.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.argv[1:] or sys.stdin:
        job = json.loads(line)
        run = time_equilibrium if job["system"] in STRUCTURES else time_run
        print(json.dumps(run(**job)), file=answers, flush=True)


if __name__ == "__main__":
    answer_jobs()
