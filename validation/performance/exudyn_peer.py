"""Hub beam and pendulum in Exudyn 1.13 or later (`pip install exudyn`).

    python validation/performance/exudyn_peer.py '{"system": "hub beam", "elements": 8}'

prints times, counts and the path of the tip. Without an argument, the script is a worker that reads
such runs from standard input, one per line (`measurement.start_exudyn`).

Beams consist of geometrically exact 2D elements of 2 or 3 nodes, curved and free of stress at the
start. The torque is a symbolic function. Runs use one thread, write no files and reuse
factorizations (modified Newton).
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

# Import the module without range checks, which prints a note.
sys.exudynFast = True
with contextlib.redirect_stdout(io.StringIO()):
    import exudyn as exu
    from exudyn import utilities as exd

Array = np.ndarray


@dataclass(frozen=True)
class Arc:
    """Arc of equal elements; angles are relative to the x-axis."""

    start: tuple[float, float]
    radius: float
    length: float
    angle: float
    elements: int

    @property
    def turn(self) -> float:
        """Angle that an element subtends [rad]."""
        return self.length / self.radius / self.elements

    def point(self, angle: float) -> list[float]:
        """Return the point whose tangent has this angle."""
        x = self.start[0] + self.radius * (np.sin(angle) - np.sin(self.angle))
        y = self.start[1] - self.radius * (np.cos(angle) - np.cos(self.angle))
        return [float(x), float(y)]


def add_beam(
    mbs: Any, arc: Arc, section: dict[str, float], nodes: int
) -> tuple[list[int], list[int]]:
    """Add elements of 2 or 3 nodes; return the nodes at their ends, and the elements."""
    angles = arc.angle + arc.turn * np.arange(arc.elements + 1)
    ends = [_add_node(mbs, arc.point(angle), angle) for angle in angles]
    half, chord = 0.5 * arc.turn, 2.0 * arc.radius * np.sin(0.5 * arc.turn)
    length = chord
    if nodes == 3:
        # Quadratic axis whose tangents at both Gauss points are those of the arc.
        gauss = 1.0 / np.sqrt(3.0)
        sag = chord * np.tan(gauss * half) / (4.0 * gauss)
        length = 2.0 * np.hypot(0.5 * chord, 2.0 * sag * gauss)
    element_numbers = []
    for k in range(arc.elements):
        element_nodes = [ends[k], ends[k + 1]]
        if nodes == 3:
            middle = angles[k] + half
            between = 0.5 * (np.array(arc.point(angles[k])) + arc.point(angles[k + 1]))
            point = between - sag * np.array([-np.sin(middle), np.cos(middle)])
            element_nodes.insert(1, _add_node(mbs, point.tolist(), middle))
        element = exd.ObjectBeamGeometricallyExact2D(
            nodeNumbers=element_nodes,
            length=length,
            referenceCurvature=arc.turn / length,
            includeReferenceRotations=True,
            **section,
        )
        element_numbers.append(mbs.AddObject(element))
    return ends, element_numbers


def _add_node(mbs: Any, point: list[float], angle: float) -> int:
    return mbs.AddNode(exd.NodeRigidBody2D(referenceCoordinates=[*point, float(angle)]))


def section_properties(
    E: float, rho: float, area: float, inertia: float, damping: float
) -> dict[str, float]:
    """Return stiffness, mass and Kelvin-Voigt damping for Poisson's ratio 0.3."""
    stiffness = {
        "bending": E * inertia,
        "axial": E * area,
        "shear": 5.0 / 6.0 * E / 2.6 * area,
    }
    return {
        "massPerLength": rho * area,
        "crossSectionInertia": rho * inertia,
        **{f"{kind}Stiffness": value for kind, value in stiffness.items()},
        **{f"{kind}Damping": damping * value for kind, value in stiffness.items()},
    }


def add_hub_beam(mbs: Any, elements: int, nodes: int, damping: float) -> int:
    """Add the beam on a hub with a torque; return the node of its tip."""
    arc = Arc((0.05, 0.0), 5.0, 5.0 * np.pi / 3.0, 0.0, elements)
    ends, _ = add_beam(
        mbs, arc, section_properties(68.952e9, 2766.7, 8e-5, 1.06667e-8, damping), nodes
    )
    node = _add_node(mbs, [0.0, 0.0], 0.0)
    hub = mbs.AddObject(exd.ObjectRigidBody2D(mass=1.0, inertia=0.3, nodeNumber=node))
    ground = mbs.AddMarker(exd.MarkerBodyPosition(bodyNumber=mbs.AddObject(exd.ObjectGround())))
    center = mbs.AddMarker(exd.MarkerBodyPosition(bodyNumber=hub))
    mbs.AddObject(exd.RevoluteJoint2D(markerNumbers=[ground, center]))
    rim = mbs.AddMarker(exd.MarkerBodyRigid(bodyNumber=hub, localPosition=[0.05, 0.0, 0.0]))
    root = mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=ends[0]))
    axes = [1, 1, 0, 0, 0, 1]
    mbs.AddObject(exd.GenericJoint(markerNumbers=[rim, root], constrainedAxes=axes))

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
    arc = Arc((0.0, 0.0), 0.85, 0.80, -0.60, elements)
    strip = section_properties(68.95e9, 2760.0, area, area * 0.0025**2 / 12.0, damping)
    ends, added = add_beam(mbs, arc, strip, nodes)
    for element in added:
        marker = mbs.AddMarker(exd.MarkerBodyMass(bodyNumber=element))
        load = exd.LoadMassProportional(markerNumber=marker, loadVector=[0.0, -gravity, 0.0])
        mbs.AddLoad(load)
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
    settings = _solver_settings(t_end, step, allowed, rho_inf)
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


def _solver_settings(end: float, step: float, tolerance: float, rho_inf: float) -> Any:
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = round(end / step), end
    integration.verboseMode = 0
    integration.generalizedAlpha.spectralRadius = rho_inf
    integration.newton.useModifiedNewton = True
    integration.newton.relativeTolerance = 1e-8
    integration.newton.absoluteTolerance = tolerance
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 0.01
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.parallel.numberOfThreads = 1
    return settings


def answer_jobs(run: Callable[..., dict[str, Any]]) -> None:
    """Answer the jobs in the arguments or, without arguments, in the lines of standard input."""
    # Output of the library goes to standard error, so that answers are the only output.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for line in sys.argv[1:] or sys.stdin:
        print(json.dumps(run(**json.loads(line))), file=answers, flush=True)


if __name__ == "__main__":
    answer_jobs(time_run)
