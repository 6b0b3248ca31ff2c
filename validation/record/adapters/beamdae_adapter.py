"""Adapter of beamdae: builds a mechanism from a problem and simulates it."""

import math
import time
import warnings
from typing import Any

import numpy as np
import pandas as pd
from geometry import law_pieces, law_value, output_columns
from scipy.optimize import brentq

import beamdae as bd

_WEAK_HYSTERESIS = 0.3  # X times the impact speed that states the same X by a restitution
MAX_STATIC_ELEMENTS = 64


def make_law(law: Any) -> Any:
    """Return the beamdae law of a law in a problem."""
    if isinstance(law, int | float):
        return float(law)
    if law["type"] == "sine":
        return bd.sine(law["amplitude"], law["frequency"], law.get("phase", 0.0))
    if law["type"] == "run_up":
        return bd.run_up(law["speed"], law["duration"])
    *pieces, (_, last) = law_pieces(law)
    return bd.piecewise(*(piece for piece in pieces if piece[0] > 0.0), last)


def make_curve(data: dict[str, Any]) -> Any:
    """Return the beamdae curve of a beam axis."""
    if data["type"] == "line":
        return bd.Line(tuple(data["start"]), tuple(data["end"]))
    start, angle = tuple(data["start"]), data.get("angle", 0.0)
    if data["type"] == "arc":
        return bd.Arc(radius=data["radius"], length=data["length"], start=start, angle=angle)
    return bd.Parabola(span=data["span"], rise=data["rise"], start=start, angle=angle)


def make_contact(data: dict[str, Any], line: Any, point: Any) -> Any:
    """Return the contact; beamdae states the hysteresis X by a restitution at an impact speed."""
    nx, ny = data["normal"]
    keywords: dict[str, Any] = {"exponent": data.get("exponent", 1.5)}
    if data.get("hysteresis"):
        z = _WEAK_HYSTERESIS

        def defect(e: float) -> float:
            return z * (1.0 + e) - math.log((1.0 + z) / (1.0 - e * z))

        keywords["restitution"] = brentq(defect, 0.5, 1.0, xtol=1e-15)
        keywords["impact_speed"] = z / data["hysteresis"]
    if data.get("friction"):
        keywords |= {"friction": data["friction"], "friction_speed": data["friction_speed"]}
    surface = bd.LineSurface(line, direction=(ny, -nx))
    return bd.Contact(data["name"], point, surface, data["stiffness"], **keywords)


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
            bd.Spring(
                data["name"],
                attach(data["a"]),
                attach(data["b"]),
                stiffness=data["stiffness"],
                damping=data.get("damping", 0.0),
                free_length=data["free_length"],
            )
        )
    for data in problem.get("contacts", []):
        mech.add(make_contact(data, attach(data["a"]), attach(data["b"])))
    if "control" in problem:
        point, start = attach(problem["control"]["on"]), problem["control"].get("from")
        mech.observe("controlled", point)
        if start is not None:
            rod = bd.Spring("rod", mech.ground.at(*start), point, stiffness=0.0)
            mech.observe("controlled.distance", mech.add(rod).elongation)
    inclinations = {}
    for data in problem["outputs"]:
        mech.observe(data["name"], attach(data["on"]))
        inclinations[data["name"]] = attach(data["on"]).inclination
    return mech, inclinations


def select_columns(
    problem: dict[str, Any], times: np.ndarray, columns: Any, inclinations: dict[str, float]
) -> pd.DataFrame:
    """Return the columns of the problem; angles are rotations from the reference configuration."""
    table = {"t [s]": times}
    for header, output, quantity in output_columns(problem):
        angle0 = inclinations[output["name"]] if quantity == "angle" else 0.0
        table[header] = columns[header] - angle0
    return pd.DataFrame(table)


def solve_static(
    problem: dict[str, Any], mech: Any, inclinations: dict[str, float]
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return the equilibria at the rows of the problem, and the status; failures end the table."""
    interval = problem["time"]["output_step"]
    times = np.arange(round(problem["time"]["end"] / interval) + 1) * interval
    control = problem.get("control")
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        if control is None:
            path = bd.equilibrium(mech, loads=[], t=0.0)
            paths = [path]
            for t in times[1:]:
                path = bd.equilibrium(mech, loads=[], t=float(t), start=path)
                if not path.status.success:
                    break
                paths.append(path)
            times = times[: len(paths)]
            columns = {key: np.array([x.columns[key][-1] for x in paths]) for key in path.columns}
        else:
            name = f"controlled.{control['quantity']}"
            start = bd.equilibrium(mech, loads=[control["load"]], to=0.0, t=0.0)
            first = next(v[0] for k, v in start.columns.items() if k.startswith(f"{name} "))
            targets = [first + law_value(control["law"], float(t)) for t in times[1:]]
            path = bd.equilibrium(mech, loads=[control["load"]], to={name: targets}, t=0.0)
            values = next(v for k, v in path.columns.items() if k.startswith(f"{name} "))
            rows = [0, *(int(np.argmin(abs(values - x))) for x in targets)]
            reached = np.abs(values[rows[1:]] - targets) < 1e-9 * np.ptp(targets)
            rows = rows[: 1 + int(np.argmin([*reached, False]))]
            times = times[: len(rows)]
            columns = {key: value[rows] for key, value in path.columns.items()}
            columns[f"{control['load']}.factor [-]"] = path.factors[rows, -1]
    notes = sorted({str(x.message) for x in issued})
    table = select_columns(problem, times, columns, inclinations)
    for key in (x for x in columns if x.endswith(".factor [-]")):
        table[key] = columns[key]
    status = {"success": path.status.success, "reason": path.status.sentence, "warnings": notes}
    return table, status


def refine_static(problem: dict[str, Any], accuracy: float) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return the path of exact beams whose elements are doubled until it hardly changes."""
    before, elements = None, 4
    while True:
        mech, inclinations = build_mechanism(problem, elements, formulation="exact")
        table, information = solve_static(problem, mech, inclinations)
        if before is not None and len(table) == len(before):
            change = (table - before).abs().max() / (0.5 * (table.max() - table.min()))
            is_accurate = change.drop("t [s]").max() <= accuracy
            if is_accurate or elements >= MAX_STATIC_ELEMENTS:
                information["success"] &= bool(is_accurate)
                return table, information
        before, elements = table, 2 * elements


def solve(
    problem: dict[str, Any], setting: str = "Auto", elements: int = 8, formulation: str = "default"
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Simulate a problem; `setting` is an integrator, or "refine" with the accuracy.

    Returns
    -------
    tuple
        Table of the outputs, and a dictionary of status and cost.
    """
    clock, processor = time.perf_counter(), time.process_time()
    keywords = {} if formulation == "default" else {"formulation": formulation}
    mech, inclinations = build_mechanism(problem, elements, **keywords)
    end, step = problem["time"]["end"], problem["time"]["output_step"]
    if problem.get("analysis") == "static":
        if setting.startswith("refine"):
            table, information = refine_static(problem, float(setting.split()[1]))
        else:
            table, information = solve_static(problem, mech, inclinations)
        information["wall_time"] = time.perf_counter() - clock
        information["processor_time"] = time.process_time() - processor
        return table, information
    settings = {"t_end": end, "output_step": step}
    if setting.startswith("refine"):
        accuracy = float(setting.split()[1])
        method = bd.Auto(time_limit=300.0)
        solution = bd.simulate(mech, method, accuracy=accuracy, **settings)
    else:
        # Such as "Auto", "Radau 1e-8" or "GeneralizedAlpha".
        name, _, rtol = setting.partition(" ")
        method = getattr(bd, name)(**({"rtol": float(rtol)} if rtol else {}))
        solution = bd.simulate(mech, method, **settings)
    information = {
        "success": solution.status.success,
        "reason": solution.status.sentence,
        "wall_time": time.perf_counter() - clock,
        "processor_time": time.process_time() - processor,
        "steps": solution.statistics.steps,
        "max_position_drift": float(solution.quality.max_position_drift),
        "energy_imbalance": float(solution.quality.energy_imbalance),
        "warnings": list(solution.warnings),
    }
    return select_columns(problem, solution.t, solution.columns, inclinations), information
