"""Adapter of beamdae: builds a mechanism from problem.json and simulates it."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pandas as pd

import beamdae as bd


def make_law(law: Any) -> Any:
    """Return the beamdae law of a law in problem.json."""
    if isinstance(law, int | float):
        return float(law)
    kind = law["type"]
    if kind == "sine":
        return bd.sine(law["amplitude"], law["frequency"], law.get("phase", 0.0))
    if kind == "run_up":
        return bd.run_up(law["speed"], law["duration"])
    if kind == "piecewise_linear":
        times, values = law["times"], law["values"]
        pieces = [
            (t1, lambda t, a=a, slope=(b - a) / (t1 - t0), t0=t0: a + slope * (t - t0))
            for t0, t1, a, b in zip(times[:-1], times[1:], values[:-1], values[1:], strict=True)
        ]
        return bd.piecewise(*pieces, values[-1])
    amplitude, duration = law["amplitude"], law["duration"]
    rate = math.pi / duration
    if kind == "versine_pulse":
        return bd.piecewise((duration, lambda t: amplitude * np.sin(rate * t) ** 2), 0.0)
    return bd.piecewise((duration, lambda t: 0.5 * amplitude * (1.0 - np.cos(rate * t))), amplitude)


def make_curve(data: dict[str, Any]) -> Any:
    """Return the beamdae curve of a beam axis."""
    if data["type"] == "line":
        return bd.Line(tuple(data["start"]), tuple(data["end"]))
    start, angle = tuple(data["start"]), data.get("angle", 0.0)
    if data["type"] == "arc":
        return bd.Arc(radius=data["radius"], length=data["length"], start=start, angle=angle)
    return bd.Parabola(span=data["span"], rise=data["rise"], start=start, angle=angle)


def build_mechanism(
    problem: dict[str, Any], elements: int = 8, **settings: Any
) -> tuple[Any, dict[str, float]]:
    """Return the mechanism and the angles of its outputs in the reference configuration.

    `settings` are keywords of `bd.Beam`, such as formulation="exact".
    """
    mech = bd.Mechanism(gravity=tuple(problem["gravity"]))
    sections = {}
    for name, data in problem["sections"].items():
        material = problem["materials"][data["material"]]
        sections[name] = bd.Section(
            bd.Material(E=material["E"], nu=material["nu"], rho=material["rho"]),
            area=data["area"],
            second_moment=data["second_moment"],
            shear_coefficient=data["shear_coefficient"],
            damping=data.get("damping_time", 0.0),
            mass_per_length=data.get("mass_per_length"),
            rotary_inertia_per_length=data.get("rotary_inertia_per_length"),
        )
    bodies: dict[str, Any] = {"ground": mech.ground}
    for data in problem["bodies"]:
        name, initial = data["name"], data.get("initial", {})
        motion = {
            "velocity": tuple(initial.get("velocity", (0.0, 0.0))),
            "angular_velocity": initial.get("angular_velocity", 0.0),
        }
        if data["type"] == "beam":
            curve, section = make_curve(data["curve"]), sections[data["section"]]
            body = bd.Beam(name, curve, section, elements, **motion, **settings)
        else:
            center = tuple(data["center"])
            body = bd.RigidBody(name, data["mass"], data["inertia"], center=center, **motion)
        bodies[name] = mech.add(body)

    def attach(data: dict[str, Any]) -> Any:
        body = bodies[data["body"]]
        if "point" in data:
            return body.at(*data["point"])
        if data["fraction"] in (0.0, 1.0):
            return body.start if data["fraction"] == 0.0 else body.end
        return body.at(data["fraction"] * body.length)

    for data in problem.get("point_masses", []):
        mech.add(bd.PointMass(data["name"], data["mass"], on=attach(data["on"])))
    for data in problem["joints"]:
        name, a, b = data["name"], attach(data["a"]), attach(data["b"])
        if data["type"] == "point_on_line":
            mech.add(bd.PointOnLine(name, a, b, direction=tuple(data["direction"])))
        elif data["type"] == "driver":
            mech.add(bd.Driver(name, a, b, law=make_law(data["law"])))
        else:
            mech.add({"revolute": bd.Revolute, "weld": bd.Weld}[data["type"]](name, a, b))
    for data in problem.get("loads", []):
        name, on = data["name"], attach(data["on"])
        if data["type"] == "moment":
            mech.add(bd.Moment(name, on=on, law=make_law(data["law"])))
        else:
            law, axes = tuple(map(make_law, data["components"])), data.get("axes", "inertial")
            mech.add(bd.Force(name, on, law, axes=axes))
    for data in problem.get("springs", []):
        mech.add(
            bd.SpringDamper(
                data["name"],
                attach(data["a"]),
                attach(data["b"]),
                stiffness=data["stiffness"],
                damping=data.get("damping", 0.0),
                free_length=data["free_length"],
            )
        )
    inclinations = {}
    for data in problem["outputs"]:
        mech.observe(data["name"], attach(data["on"]))
        inclinations[data["name"]] = attach(data["on"]).inclination
    return mech, inclinations


def make_integrator(setting: str) -> Any:
    """Return the integrator of a setting such as "Auto", "Radau 1e-8" or "GeneralizedAlpha"."""
    name, _, rtol = setting.partition(" ")
    return getattr(bd, name)(**({"rtol": float(rtol)} if rtol else {}))


def select_columns(
    problem: dict[str, Any], solution: Any, inclinations: dict[str, float]
) -> pd.DataFrame:
    """Return the columns of the problem; angles are rotations from the reference configuration."""
    table, columns = solution.table(), {"t [s]": solution.t}
    for output in problem["outputs"]:
        for quantity in output["quantities"]:
            name = f"{output['name']}.{quantity} [{'rad' if quantity == 'angle' else 'm'}]"
            angle0 = inclinations[output["name"]] if quantity == "angle" else 0.0
            columns[name] = table[name].to_numpy() - angle0
    return pd.DataFrame(columns)


def solve(
    problem: dict[str, Any], setting: str = "Auto", elements: int = 8, formulation: str = "default"
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Simulate a problem; `setting` is an integrator, or "certify" with the accuracy.

    Returns
    -------
    tuple
        Table of the outputs, and a dictionary of status and cost.
    """
    clock, processor = time.perf_counter(), time.process_time()
    keywords = {} if formulation == "default" else {"formulation": formulation}
    mech, inclinations = build_mechanism(problem, elements, **keywords)
    end, step = problem["time"]["end"], problem["time"]["output_step"]
    information: dict[str, Any] = {}
    if setting.startswith("certify"):
        accuracy = float(setting.split()[1])
        certificate = bd.certify(mech, accuracy, t_end=end, output_step=step, time_limit=300.0)
        solution = certificate.solution
        information["success"], information["reason"] = certificate.success, certificate.reason
        if certificate.budget is not None:
            information["budget"] = certificate.budget["total"].to_dict()
    else:
        solution = bd.simulate(mech, make_integrator(setting), t_end=end, output_step=step)
        information["success"] = solution.status.success
        information["reason"] = solution.status.sentence
    information |= {
        "wall_time": time.perf_counter() - clock,
        "processor_time": time.process_time() - processor,
    }
    if solution is None:
        return pd.DataFrame(), information
    information |= {
        "steps": solution.statistics.steps,
        "max_position_drift": float(solution.quality.max_position_drift),
        "energy_imbalance": float(solution.quality.energy_imbalance),
        "warnings": list(solution.warnings),
    }
    return select_columns(problem, solution, inclinations), information
