"""Adapter of Exudyn: geometrically exact beams and generalized-alpha.

Both errors are of second order: `solve` extrapolates from half the elements and from twice the
step, by Richardson's method.
"""

import math
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
import pandas as pd
from exudyn import utilities as exd

sys.path.append(str(Path(__file__).resolve().parents[1]))
from geometry import (
    QUANTITIES,
    attached_fractions,
    contact_force,
    law_pieces,
    law_value,
    make_curve,
    output_columns,
    rotation,
)

_SPECTRAL_RADIUS = 0.9


class System:
    """Exudyn system of a problem, with about `elements` elements of 2 or 3 nodes per beam.

    Each element of a mesh of `elements` / `split` is divided into `split`.
    """

    def __init__(
        self, problem: dict[str, Any], elements: int, nodes: int = 2, split: int = 1
    ) -> None:
        self.problem = problem
        self.mbs = exu.SystemContainer().AddSystem()
        self.ground = self.mbs.AddObject(exd.ObjectGround())
        self.gravity = np.array([*problem["gravity"], 0.0])
        self.largest_stiffness = 0.0
        # Fraction, number and angle of each node; item, node and center.
        self.beams: dict[str, list[tuple[float, int, float]]] = {}
        self.rigid: dict[str, tuple[int, int, np.ndarray]] = {}
        for body in problem["bodies"]:
            if body["type"] == "beam":
                self._add_beam(body, elements, nodes, split)
            else:
                node = self._add_node(body["center"], 0.0, body)
                item = exd.ObjectRigidBody2D(
                    mass=body["mass"], inertia=body["inertia"], nodeNumber=node
                )
                center = np.array(body["center"])
                self.rigid[body["name"]] = self._add_heavy(item), node, center
        for particle in problem.get("point_masses", []):
            mass = particle["mass"]
            item = exd.ObjectGenericODE2(
                nodeNumbers=[self.node(particle["on"])],
                massMatrix=np.diag([mass, mass, 0.0]),
                forceVector=mass * self.gravity,
            )
            self.mbs.AddObject(item)
        for joint in problem["joints"]:
            self._add_joint(joint)
        controlled = problem.get("control", {}).get("load")
        for load in problem.get("loads", []):
            if (
                load["name"] != controlled
            ):  # the reaction of the prescribed displacement replaces it
                self._add_load(load)
        for contact in problem.get("contacts", []):
            self._add_contact(contact)
        for spring in problem.get("springs", []):
            item = exd.ObjectConnectorSpringDamper(
                markerNumbers=self._markers(spring),
                referenceLength=spring["free_length"],
                stiffness=spring["stiffness"],
                damping=spring.get("damping", 0.0),
            )
            self.mbs.AddObject(item)

    def _add_node(self, point: Any, angle: float, body: dict[str, Any], origin: Any = None) -> int:
        """Add a node of a body that starts to move with its `origin`, by default the point."""
        initial, origin = body.get("initial", {}), point if origin is None else origin
        spin, (vx, vy) = initial.get("angular_velocity", 0.0), initial.get("velocity", (0, 0))
        rates = [vx - spin * (point[1] - origin[1]), vy + spin * (point[0] - origin[0]), spin]
        reference = [*map(float, point), float(angle)]
        node = exd.NodeRigidBody2D(referenceCoordinates=reference, initialVelocities=rates)
        return self.mbs.AddNode(node)

    def _add_heavy(self, item: Any) -> int:
        """Add an object with its weight."""
        number = self.mbs.AddObject(item)
        if np.any(self.gravity):
            marker = self.mbs.AddMarker(exd.MarkerBodyMass(bodyNumber=number))
            load = exd.LoadMassProportional(markerNumber=marker, loadVector=self.gravity)
            self.mbs.AddLoad(load)
        return number

    def _add_beam(self, body: dict[str, Any], elements: int, nodes: int, split: int) -> None:
        section = self.problem["sections"][body["section"]]
        material = self.problem["materials"][section["material"]]
        E, rho, area = material["E"], material["rho"], section["area"]
        stiffness = {
            "axial": E * area,
            "shear": section["shear_coefficient"] * E / (2.0 * (1.0 + material["nu"])) * area,
            "bending": E * section["second_moment"],
        }
        tau = section.get("damping_time", 0.0)
        inertia = section.get("rotary_inertia_per_length", rho * section["second_moment"])
        properties = {
            "massPerLength": section.get("mass_per_length", rho * area),
            "crossSectionInertia": inertia,
            **{f"{kind}Stiffness": value for kind, value in stiffness.items()},
            **{f"{kind}Damping": tau * value for kind, value in stiffness.items()},
        }
        self.largest_stiffness = max(self.largest_stiffness, E * area)
        curve, ends = make_curve(body["curve"]), [0.0]
        for a, b in pairwise(sorted({0.0, 1.0, *attached_fractions(self.problem, body["name"])})):
            count = split * max(1, round(elements / split * (b - a)))
            ends += list(np.linspace(a, b, count + 1)[1:])
        points = [curve.point(x * curve.length) for x in ends]
        # Where the curvature varies, curved elements would start with shear forces; straight ones
        # are free of stress.
        is_curved = body["curve"]["type"] != "parabola"
        angles = [curve.angle(x * curve.length) if is_curved else 0.0 for x in ends]
        numbers = [
            self._add_node(point, angle, body, points[0])
            for point, angle in zip(points, angles, strict=True)
        ]
        self.beams[body["name"]] = list(zip(ends, numbers, angles, strict=True))
        for k in range(len(ends) - 1):
            half, middle = 0.5 * (angles[k + 1] - angles[k]), 0.5 * (angles[k + 1] + angles[k])
            length = chord = float(np.hypot(*(points[k + 1] - points[k])))
            element_nodes = numbers[k : k + 2]
            if nodes == 3:
                # Quadratic axis whose tangents at both Gauss points are those of the arc.
                gauss = 1.0 / math.sqrt(3.0)
                sag = chord * math.tan(gauss * half) / (4.0 * gauss)
                length = 2.0 * math.hypot(0.5 * chord, 2.0 * sag * gauss)
                point = 0.5 * (points[k] + points[k + 1]) - rotation(middle) @ [0.0, sag]
                element_nodes.insert(1, self._add_node(point, middle, body, points[0]))
            element = exd.ObjectBeamGeometricallyExact2D(
                nodeNumbers=element_nodes,
                length=length,
                referenceCurvature=2.0 * half / length,
                includeReferenceRotations=is_curved,
                **properties,
            )
            self._add_heavy(element)

    def node(self, attachment: dict[str, Any]) -> int:
        """Return the node of an attachment to a body."""
        if attachment["body"] in self.rigid:
            return self.rigid[attachment["body"]][1]
        return self._nearest(attachment)[1]

    def _nearest(self, attachment: dict[str, Any]) -> tuple[float, int, float]:
        """Return fraction, number and angle of the node of an attachment to a beam."""
        nodes, fraction = self.beams[attachment["body"]], attachment["fraction"]
        return min(nodes, key=lambda node: abs(node[0] - fraction))

    def _angle(self, attachment: dict[str, Any]) -> float:
        """Return the reference angle of the node of an attachment."""
        return self._nearest(attachment)[2] if attachment["body"] in self.beams else 0.0

    def _marker(self, attachment: dict[str, Any]) -> int:
        if attachment["body"] in self.beams:
            return self.mbs.AddMarker(exd.MarkerNodeRigid(nodeNumber=self.node(attachment)))
        item, _, center = self.rigid.get(attachment["body"], (self.ground, 0, np.zeros(2)))
        local = [*map(float, np.array(attachment["point"]) - center), 0.0]
        return self.mbs.AddMarker(exd.MarkerBodyRigid(bodyNumber=item, localPosition=local))

    def _markers(self, pair: dict[str, Any]) -> list[int]:
        return [self._marker(pair[end]) for end in "ab"]

    def _coordinate(self, attachment: dict[str, Any], coordinate: int) -> int:
        """Return the marker of a coordinate of a node."""
        on_ground = attachment["body"] == "ground"
        node = self.mbs.AddNode(exd.NodePointGround()) if on_ground else self.node(attachment)
        coordinate = 0 if on_ground else coordinate
        return self.mbs.AddMarker(exd.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))

    def add_driver(self, a: dict[str, Any], b: dict[str, Any], law: Any, coordinate: int) -> int:
        """Prescribe the difference of a coordinate from the reference configuration."""
        item = exd.ObjectConnectorCoordinate(
            markerNumbers=[self._coordinate(a, coordinate), self._coordinate(b, coordinate)],
            offsetUserFunction=lambda mbs, t, item, offset: law_value(law, t),
        )
        return self.mbs.AddObject(item)

    def _add_joint(self, joint: dict[str, Any]) -> None:
        a, b = joint["a"], joint["b"]
        if joint["type"] == "driver":
            self.add_driver(a, b, joint["law"], 2)
        elif joint["type"] == "revolute":
            self.mbs.AddObject(exd.ObjectJointRevolute2D(markerNumbers=self._markers(joint)))
        else:
            axes, angle = [1, 1, 0, 0, 0, 1], 0.0
            if joint["type"] == "weld":
                angle = self._angle(b) - self._angle(a)
            else:
                axes, angle = [0, 1, 0, 0, 0, 0], math.atan2(*joint["direction"][::-1])
            turned = np.eye(3)
            turned[:2, :2] = rotation(angle)
            markers = self._markers(joint)
            item = exd.ObjectJointGeneric(
                markerNumbers=markers, constrainedAxes=axes, rotationMarker0=turned
            )
            self.mbs.AddObject(item)

    def _add_load(self, load: dict[str, Any]) -> None:
        laws, kind = [0.0, 0.0, load.get("law", 0.0)], exd.LoadTorqueVector
        if load["type"] == "force":
            laws, kind = [*load["components"], 0.0], exd.LoadForceVector
            if load.get("axes", "inertial") == "body":
                raise NotImplementedError("follower forces are not supported")
        vector = [x if isinstance(x, int | float) else 0.0 for x in laws]
        number = self.mbs.AddLoad(kind(markerNumber=self._marker(load["on"]), loadVector=vector))
        if vector == laws:
            return
        name, pieces = "loadVectorUserFunction", [law_pieces(law, exu.symbolic) for law in laws]
        function = lambda mbs, t, load: [law_value(law, t) for law in laws]  # noqa: E731
        self.mbs.SetLoadParameter(number, name, function)
        if all(len(x) == 1 for x in pieces):  # Smooth laws are evaluated without Python.

            def evaluate(mbs: Any, t: Any, load: Any) -> list[Any]:
                return [x[0][1](t) for x in pieces]

            symbolic = exd.CreateSymbolicUserFunction(self.mbs, evaluate, name, number)
            self.mbs.SetLoadParameter(number, name, symbolic)

    def _add_contact(self, contact: dict[str, Any]) -> None:
        local = contact | {"a": {"point": [0.0, 0.0]}}

        def force(
            mbs: Any, t: float, item: int, u: Any, v: Any, k: Any, d: Any, offset: Any
        ) -> list[float]:
            # The connector acts on its second marker with the opposite sign.
            return [*-contact_force(local, np.array(u[:2]), np.array(v[:2])), 0.0]

        item = exd.ObjectConnectorCartesianSpringDamper(
            markerNumbers=self._markers(contact), springForceUserFunction=force
        )
        self.mbs.AddObject(item)

    def settings(self, end: float, step: float) -> Any:
        """Return settings for one thread and no files, with a fixed step."""
        settings = exu.SimulationSettings()
        integration, static = settings.timeIntegration, settings.staticSolver
        integration.numberOfSteps, integration.endTime = round(end / step), end
        static.numberOfLoadSteps, static.loadStepDuration = round(end / step), end
        integration.generalizedAlpha.spectralRadius = _SPECTRAL_RADIUS
        integration.newton.useModifiedNewton = True
        for solver in (integration, static):
            solver.verboseMode, solver.adaptiveStep = 0, False
            solver.newton.relativeTolerance = 1e-8
            # Forces are rounded relative to EA.
            solver.newton.absoluteTolerance = max(1e-10, 1e-12 * self.largest_stiffness)
        static.newton.useModifiedNewton = False
        settings.solution.file.write = False
        settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        settings.parallel.numberOfThreads = 1
        return settings


def simulate(problem: dict[str, Any], elements: int, step: float, split: int = 1) -> pd.DataFrame:
    """Simulate with two-node elements and a fixed step [s]."""
    system = System(problem, elements, split=split)
    mbs, kinds = system.mbs, exu.OutputVariableType
    stored: dict[str, Any] = {"storeInternal": True, "writeToFile": False}
    sensors: dict[str, tuple[int, int, float]] = {}  # number, column and unit
    for header, output, quantity in output_columns(problem):
        on, is_angle = output["on"], quantity == "angle"
        variable = {"outputVariableType": kinds.Rotation if is_angle else kinds.Position}
        if on["body"] in system.rigid and not is_angle:
            item, _, center = system.rigid[on["body"]]
            local = [*map(float, np.array(on["point"]) - center), 0.0]
            sensor = exd.SensorBody(bodyNumber=item, localPosition=local, **variable, **stored)
        else:
            sensor = exd.SensorNode(nodeNumber=system.node(on), **variable, **stored)
        column = -1 if is_angle else 1 + QUANTITIES.index(quantity)
        sensors[header] = mbs.AddSensor(sensor), column, 1.0
    if control := problem.get("control"):
        load = next(x for x in problem["loads"] if x["name"] == control["load"])
        controlled = QUANTITIES.index(control["quantity"].replace("distance", "angle"))
        force = [*load.get("components", [0.0, 0.0]), load.get("law", 0.0)]
        if control["on"] != load["on"] or [i for i in range(3) if force[i]] != [controlled]:
            raise NotImplementedError("only the displacement along the load can be controlled")
        held = system.add_driver({"body": "ground"}, control["on"], control["law"], controlled)
        variable = {"outputVariableType": kinds.Force}
        sensor = mbs.AddSensor(exd.SensorObject(objectNumber=held, **variable, **stored))
        sensors[f"{load['name']}.factor [-]"] = sensor, 1, force[controlled]
    mbs.Assemble()
    end, interval = problem["time"]["end"], problem["time"]["output_step"]
    settings = system.settings(end, step)
    settings.staticSolver.useLoadFactor = False
    settings.solution.sensors.writePeriod = 0.5 * step  # every step
    if problem.get("analysis") == "static":
        mbs.SolveStatic(settings)
    else:
        mbs.SolveDynamic(settings)
    columns = {"t [s]": np.arange(round(end / interval) + 1) * interval}
    for header, (sensor, column, unit) in sensors.items():
        data = np.array(mbs.GetSensorStoredData(sensor))
        rows = np.searchsorted(data[:, 0], columns["t [s]"] - 0.5 * step)
        if np.abs(data[rows, 0] - columns["t [s]"]).max() > 0.01 * step:
            raise RuntimeError(f"Exudyn did not store all output times, {data.shape}")
        columns[header] = data[rows, column] / unit
        if header.endswith("[rad]"):
            columns[header] = columns[header] - columns[header][0]
    return pd.DataFrame(columns)


def solve(
    problem: dict[str, Any], elements: int = 32, step: float = 1e-3
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return the extrapolated columns, and status and cost; two meshes and two steps.

    Static problems are extrapolated from two meshes; their step is one row.
    """
    clock, processor = time.perf_counter(), time.process_time()
    is_static, text = problem.get("analysis") == "static", f"Richardson: {elements} elements"
    first = problem["time"]["output_step"] if is_static else 2.0 * step
    coarse = simulate(problem, elements // 2, first)
    # At (elements, step), errors of second order are 1/3 of the differences.
    best = coarse + (simulate(problem, elements, first, split=2) - coarse) * (4.0 / 3.0)
    if not is_static:
        best += (simulate(problem, elements // 2, step) - coarse) * (4.0 / 3.0)
        text += f", step {step:g} s"
    best["t [s]"] = coarse["t [s]"]
    return best, {
        "success": True,
        "reason": text,
        "wall_time": time.perf_counter() - clock,
        "processor_time": time.process_time() - processor,
    }
