"""Adapter of Exudyn: two-node geometrically exact beams and generalized-alpha.

Both errors are of second order: `solve` extrapolates from half the elements and from twice the
step, by Richardson's method.
"""

from __future__ import annotations

import math
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
import pandas as pd
from exudyn import itemInterface as items  # noqa: N813

sys.path.append(str(Path(__file__).resolve().parents[1]))
from geometry import attachments, contact_force, law_value, make_curve

_SPECTRAL_RADIUS = 0.9


def simulate(problem: dict[str, Any], elements: int, step: float) -> pd.DataFrame:
    """Simulate with about `elements` elements per beam and a fixed step [s]."""
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    gravity = np.array([*problem["gravity"], 0.0])
    ground = mbs.AddObject(items.ObjectGround())
    largest_stiffness = 0.0
    nodes: dict[str, list[tuple[float, int]]] = {}
    rigid: dict[str, tuple[int, int, np.ndarray]] = {}

    def add_node(point: Any, angle: float, origin: Any, initial: dict[str, Any]) -> int:
        spin, (vx, vy) = initial.get("angular_velocity", 0.0), initial.get("velocity", (0, 0))
        rates = [vx - spin * (point[1] - origin[1]), vy + spin * (point[0] - origin[0]), spin]
        return mbs.AddNode(
            items.NodeRigidBody2D(
                referenceCoordinates=[*map(float, point), angle], initialVelocities=rates
            )
        )

    for body in problem["bodies"]:
        name, initial = body["name"], body.get("initial", {})
        if body["type"] == "rigid":
            node = add_node(body["center"], 0.0, body["center"], initial)
            item = mbs.AddObject(
                items.ObjectRigidBody2D(mass=body["mass"], inertia=body["inertia"], nodeNumber=node)
            )
            rigid[name] = item, node, np.array(body["center"])
            weighted = [item]
        else:
            section = problem["sections"][body["section"]]
            material = problem["materials"][section["material"]]
            E, A, I = material["E"], section["area"], section["second_moment"]  # noqa: E741
            GA = section["shear_coefficient"] * E / (2.0 * (1.0 + material["nu"])) * A
            tau = section.get("damping_time", 0.0)
            largest_stiffness = max(largest_stiffness, E * A)
            curve = make_curve(body["curve"])
            fractions = [a["fraction"] for a in attachments(problem) if a["body"] == name]
            cuts, ends = sorted({0.0, 1.0, *map(float, fractions)}), [0.0]
            for a, b in pairwise(cuts):
                count = 2 * max(1, round(elements * (b - a) / 2.0))
                ends += list(np.linspace(a, b, count + 1)[1:])
            s = np.array(ends) * curve.length
            points, angles = [curve.point(x) for x in s], [curve.angle(x) for x in s]
            # Where the curvature varies, curved two-node elements would start with shear forces;
            # straight ones are free of stress.
            is_curved = body["curve"]["type"] != "parabola"
            if not is_curved:
                angles = [0.0] * len(s)
            added = [
                add_node(p, angle, points[0], initial)
                for p, angle in zip(points, angles, strict=True)
            ]
            nodes[name] = list(zip(ends, added, strict=True))
            weighted = []
            for k in range(len(s) - 1):
                chord = float(np.hypot(*(points[k + 1] - points[k])))
                weighted.append(
                    mbs.AddObject(
                        items.ObjectBeamGeometricallyExact2D(
                            nodeNumbers=added[k : k + 2],
                            length=chord,
                            referenceCurvature=(angles[k + 1] - angles[k]) / chord,
                            includeReferenceRotations=is_curved,
                            massPerLength=section.get("mass_per_length", material["rho"] * A),
                            crossSectionInertia=section.get(
                                "rotary_inertia_per_length", material["rho"] * I
                            ),
                            axialStiffness=E * A,
                            shearStiffness=GA,
                            bendingStiffness=E * I,
                            axialDamping=tau * E * A,
                            shearDamping=tau * GA,
                            bendingDamping=tau * E * I,
                        )
                    )
                )
        if np.any(gravity):
            for item in weighted:
                marker = mbs.AddMarker(items.MarkerBodyMass(bodyNumber=item))
                mbs.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=gravity))

    def node_of(attachment: dict[str, Any]) -> int:
        if attachment["body"] in rigid:
            return rigid[attachment["body"]][1]
        return min(nodes[attachment["body"]], key=lambda x: abs(x[0] - attachment["fraction"]))[1]

    def marker_of(attachment: dict[str, Any]) -> int:
        if attachment["body"] in nodes:
            return mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=node_of(attachment)))
        item, center = ground, np.zeros(2)
        if attachment["body"] != "ground":
            item, _, center = rigid[attachment["body"]]
        local = [*map(float, np.array(attachment["point"]) - center), 0.0]
        return mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=item, localPosition=local))

    def angle_marker(attachment: dict[str, Any]) -> int:
        if attachment["body"] == "ground":
            node = mbs.AddNode(items.NodePointGround())
            return mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        return mbs.AddMarker(
            items.MarkerNodeCoordinate(nodeNumber=node_of(attachment), coordinate=2)
        )

    def node_angle(attachment: dict[str, Any]) -> float:
        body = {x["name"]: x for x in problem["bodies"]}.get(attachment["body"], {})
        if body.get("type") != "beam" or body["curve"]["type"] == "parabola":
            return 0.0
        curve = make_curve(body["curve"])
        return curve.angle(attachment["fraction"] * curve.length)

    for particle in problem.get("point_masses", []):
        mass = particle["mass"]
        mbs.AddObject(
            items.ObjectGenericODE2(
                nodeNumbers=[node_of(particle["on"])],
                massMatrix=np.diag([mass, mass, 0.0]),
                forceVector=mass * gravity,
            )
        )
    for joint in problem["joints"]:
        kind, a, b = joint["type"], joint["a"], joint["b"]
        if kind == "driver":
            # Coordinates are rotations from the reference configuration.
            law = joint["law"]
            mbs.AddObject(
                items.ObjectConnectorCoordinate(
                    markerNumbers=[angle_marker(a), angle_marker(b)],
                    offsetUserFunction=lambda mbs, t, item, offset, law=law: law_value(law, t),
                )
            )
        if kind == "weld":
            angle = node_angle(b) - node_angle(a)
            c, s = math.cos(angle), math.sin(angle)
            mbs.AddObject(
                items.ObjectJointGeneric(
                    markerNumbers=[marker_of(a), marker_of(b)],
                    constrainedAxes=[1, 1, 0, 0, 0, 1],
                    rotationMarker0=[[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]],
                )
            )
        if kind == "revolute":
            mbs.AddObject(items.ObjectJointRevolute2D(markerNumbers=[marker_of(a), marker_of(b)]))
        elif kind == "point_on_line":
            dx, dy = np.array(joint["direction"]) / np.hypot(*joint["direction"])
            mbs.AddObject(
                items.ObjectJointGeneric(
                    markerNumbers=[marker_of(a), marker_of(b)],
                    constrainedAxes=[0, 1, 0, 0, 0, 0],
                    rotationMarker0=[[dx, -dy, 0.0], [dy, dx, 0.0], [0.0, 0.0, 1.0]],
                )
            )
    for load in problem.get("loads", []):
        if load["name"] == problem.get("control", {}).get("load"):
            continue  # the reaction of the prescribed displacement replaces it
        marker = marker_of(load["on"])
        if load["type"] == "moment":
            mbs.AddLoad(
                items.LoadTorqueVector(
                    markerNumber=marker,
                    loadVector=[0.0, 0.0, 0.0],
                    loadVectorUserFunction=lambda mbs, t, load, law=load["law"]: [
                        0.0,
                        0.0,
                        law_value(law, t),
                    ],
                )
            )
            continue
        laws = load["components"]
        if load.get("axes", "inertial") == "body":
            raise NotImplementedError("follower forces are not supported")
        mbs.AddLoad(
            items.LoadForceVector(
                markerNumber=marker,
                loadVector=[0.0, 0.0, 0.0],
                loadVectorUserFunction=lambda mbs, t, load, laws=laws: [
                    law_value(laws[0], t),
                    law_value(laws[1], t),
                    0.0,
                ],
            )
        )
    for contact in problem.get("contacts", []):
        # The connector acts on its second marker with the opposite sign.
        mbs.AddObject(
            items.ObjectConnectorCartesianSpringDamper(
                markerNumbers=[marker_of(contact["a"]), marker_of(contact["b"])],
                springForceUserFunction=lambda mbs, t, item, u, v, k, d, offset, contact=contact: [
                    *-contact_force(
                        {**contact, "a": {"point": [0.0, 0.0]}}, np.array(u[:2]), np.array(v[:2])
                    ),
                    0.0,
                ],
            )
        )
    for spring in problem.get("springs", []):
        mbs.AddObject(
            items.ObjectConnectorSpringDamper(
                markerNumbers=[marker_of(spring["a"]), marker_of(spring["b"])],
                referenceLength=spring["free_length"],
                stiffness=spring["stiffness"],
                damping=spring.get("damping", 0.0),
            )
        )
    kinds = exu.OutputVariableType
    sensors: dict[str, tuple[int, int]] = {}
    for output in problem["outputs"]:
        on = output["on"]
        for quantity in output["quantities"]:
            variable = kinds.Rotation if quantity == "angle" else kinds.Position
            settings = {"storeInternal": True, "writeToFile": False, "outputVariableType": variable}
            if on["body"] in rigid and quantity != "angle":
                item, _, center = rigid[on["body"]]
                local = [*map(float, np.array(on["point"]) - center), 0.0]
                sensor = mbs.AddSensor(
                    items.SensorBody(bodyNumber=item, localPosition=local, **settings)
                )
            else:
                sensor = mbs.AddSensor(items.SensorNode(nodeNumber=node_of(on), **settings))
            unit = "rad" if quantity == "angle" else "m"
            column = {"x": 1, "y": 2, "angle": -1}[quantity]
            sensors[f"{output['name']}.{quantity} [{unit}]"] = sensor, column
    control, reaction = problem.get("control"), None
    if control:
        load = next(x for x in problem["loads"] if x["name"] == control["load"])
        controlled = ["x", "y", "angle"].index(control["quantity"].replace("distance", "angle"))
        force = [*load.get("components", [0.0, 0.0]), load.get("law", 0.0)]
        if control["on"] != load["on"] or [i for i in range(3) if force[i]] != [controlled]:
            raise NotImplementedError("only the displacement along the load can be controlled")
        zero = mbs.AddMarker(
            items.MarkerNodeCoordinate(
                nodeNumber=mbs.AddNode(items.NodePointGround()), coordinate=0
            )
        )
        node = mbs.AddMarker(
            items.MarkerNodeCoordinate(nodeNumber=node_of(control["on"]), coordinate=controlled)
        )
        held = mbs.AddObject(
            items.ObjectConnectorCoordinate(
                markerNumbers=[zero, node],
                offsetUserFunction=lambda mbs, t, item, offset: law_value(control["law"], t),
            )
        )
        reaction = mbs.AddSensor(
            items.SensorObject(
                objectNumber=held,
                storeInternal=True,
                writeToFile=False,
                outputVariableType=exu.OutputVariableType.Force,
            )
        )
    mbs.Assemble()
    end, interval = problem["time"]["end"], problem["time"]["output_step"]
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = round(end / step), end
    integration.verboseMode = 0
    integration.generalizedAlpha.spectralRadius = _SPECTRAL_RADIUS
    integration.newton.relativeTolerance = 1e-8
    # Forces are rounded relative to EA.
    integration.newton.absoluteTolerance = max(1e-10, 1e-12 * largest_stiffness)
    integration.newton.useModifiedNewton = True
    integration.adaptiveStep = False
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 0.5 * step  # every step
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    settings.parallel.numberOfThreads = 1
    if problem.get("analysis") == "static":
        static = settings.staticSolver
        static.numberOfLoadSteps, static.loadStepDuration = round(end / step), end
        static.verboseMode = 0
        static.newton.relativeTolerance = 1e-8
        static.newton.absoluteTolerance = integration.newton.absoluteTolerance
        static.newton.useModifiedNewton = False
        static.adaptiveStep = False
        mbs.SolveStatic(settings)
    else:
        mbs.SolveDynamic(settings)
    count = round(end / interval)
    columns = {"t [s]": np.arange(count + 1) * interval}
    for name, (sensor, column) in sensors.items():
        data = np.array(mbs.GetSensorStoredData(sensor))
        rows = np.searchsorted(data[:, 0], columns["t [s]"] - 0.5 * step)
        if np.abs(data[rows, 0] - columns["t [s]"]).max() > 0.01 * step:
            raise RuntimeError(
                f"Exudyn did not store all output times {data.shape} {data[:5, 0]} {data[-3:, 0]}"
            )
        columns[name] = data[rows, column]
        if name.endswith("[rad]"):
            columns[name] = columns[name] - columns[name][0]
    if reaction is not None:
        data = np.array(mbs.GetSensorStoredData(reaction))
        rows = np.searchsorted(data[:, 0], columns["t [s]"] - 0.5 * step)
        columns[f"{control['load']}.factor [-]"] = data[rows, 1] / force[controlled]
    return pd.DataFrame(columns)


def solve(
    problem: dict[str, Any], elements: int = 32, step: float = 1e-3
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return the extrapolated columns, and status and cost; two meshes and two steps.

    Static problems are extrapolated from two meshes; their step is one row.
    """
    clock, processor = time.perf_counter(), time.process_time()
    if problem.get("analysis") == "static":
        step = problem["time"]["output_step"]
        coarse, fine = (simulate(problem, count, step) for count in (elements // 2, elements))
        best = coarse + (fine - coarse) * (4.0 / 3.0)
        best["t [s]"] = coarse["t [s]"]
        return best, {
            "success": True,
            "reason": f"Richardson: {elements} elements",
            "wall_time": time.perf_counter() - clock,
            "processor_time": time.process_time() - processor,
        }
    coarse = simulate(problem, elements // 2, 2.0 * step)
    finer_mesh = simulate(problem, elements, 2.0 * step)
    finer_step = simulate(problem, elements // 2, step)
    mesh, time_error = (finer_mesh - coarse) / 3.0, (finer_step - coarse) / 3.0
    # At (elements, step), errors of second order are 1/3 of the differences.
    best = coarse + 4.0 * mesh + 4.0 * time_error
    best["t [s]"] = coarse["t [s]"]
    information = {
        "success": True,
        "reason": f"Richardson: {elements} elements, step {step:g} s",
        "wall_time": time.perf_counter() - clock,
        "processor_time": time.process_time() - processor,
    }
    return best, information
