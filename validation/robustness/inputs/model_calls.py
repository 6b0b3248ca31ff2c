"""Working calls of parts, curves, sections, laws, mechanisms and constrained systems.

Most are the samples of the tests; the others are variants of these samples.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from robustness.inputs.sandbox import (
    KNEE,
    Sandbox,
    WorkingCall,
    run_with_curve,
    run_with_law,
    run_with_mass_at,
    run_with_observable,
    run_with_part,
    run_with_section,
)
from sample_parts import SAMPLES

import beamdae as bd
from beamdae import catalog
from beamdae.analysis.gradients.objectives import SampleGrid

_PROPERTIES = ("coordinates", "initial_position", "initial_velocity", "outline", "laws")
_METHODS = ("forces", "constraints", "ranges", "draw")
_INHERITED = object()  # value of a member that the subclass does not override


def _make_part(sandbox: Sandbox, **members: Any) -> bd.Part:
    """Return a part of a user's class that overrides members with constant values."""
    answers = {
        name: (lambda self, *a, value=value: value)
        if name in _METHODS
        else property(lambda self, value=value: value)
        for name, value in members.items()
        if value is not _INHERITED
    }
    return type("Odd", (bd.RigidBody,), answers)("odd", 1.0, 0.1, (3.0, 0.0))


def _part_members(sandbox: Sandbox) -> dict[str, Any]:
    return dict.fromkeys((*_PROPERTIES, *_METHODS), _INHERITED)


def _attachment_members(sandbox: Sandbox) -> dict[str, Any]:
    at = sandbox.bar.at(*KNEE)
    names = ("body", "point", "inclination", "operator", "kinematics", "has_angle", "s")
    return {name: getattr(at, name) for name in names}


def _run_with_pin_at(sandbox: Sandbox, place: Any) -> bd.results.Solution:
    post = sandbox.mech.add(bd.RigidBody("post", 1.0, 0.1, (4.0, 0.0)))
    return run_with_part(sandbox, bd.Revolute("pin", place, post.at(3.0, 0.0)))


def _run_with_falling_body(sandbox: Sandbox, mech: bd.Mechanism) -> bd.results.Solution:
    bob = mech.add(bd.RigidBody("bob", 1.0, 0.1))
    mech.observe("place", bob.at(0.0, 0.0))
    return sandbox.run(mech)


def _run_with_observable_named(sandbox: Sandbox, name: str, what: Any) -> bd.results.Solution:
    sandbox.mech.observe(name, what)
    return sandbox.run()


VARIANT_CALLS: dict[str, WorkingCall] = {
    "Attachment": WorkingCall(_attachment_members, run_with_mass_at),
    "activate": WorkingCall(
        lambda box: {"part": box.mech.part("hinge"), "as_is": True},
        call=lambda box, part, as_is: bd.activate(part, as_is=as_is),
    ),
    "deactivate": WorkingCall(
        lambda box: {"part": bd.Moment("load", box.bar.at(*KNEE), 1.0)},
        call=lambda box, part: bd.deactivate(part),
    ),
    "change_law": WorkingCall(
        lambda box: {
            "driver": bd.Driver("driver", box.mech.ground.at(*KNEE), box.bar.at(*KNEE), 0.0),
            "law": 1.0,
        }
    ),
    "impact": WorkingCall(lambda box: {"on": box.mech.part("hinge"), "restitution": 0.5}),
    "Part": WorkingCall(_part_members, run_with_part, call=_make_part),
    "PointMass on": WorkingCall(
        lambda box: {"name": "mass", "mass": 0.1, "on": box.bar.at(*KNEE)}, run_with_part
    ),
    "RigidBody.rod": WorkingCall(
        lambda box: {
            "name": "rod",
            "a": (3.0, 0.0),
            "b": (4.0, 0.0),
            "density": 7850.0,
            "area": 1e-4,
        },
        run_with_part,
    ),
    "RigidBody.disk": WorkingCall(
        lambda box: {
            "name": "wheel",
            "center": (3.0, 0.0),
            "radius": 0.1,
            "density": 7850.0,
            "thickness": 0.01,
        },
        run_with_part,
    ),
    "RigidBody.plate": WorkingCall(
        lambda box: {
            "name": "plate",
            "center": (3.0, 0.0),
            "width": 0.2,
            "height": 0.1,
            "angle": 0.0,
            "mass": 1.0,
        },
        run_with_part,
    ),
    "RigidBody.polygon": WorkingCall(
        lambda box: {
            "name": "wedge",
            "points": [(3.0, 0.0), (3.1, 0.0), (3.0, 0.1)],
            "mass": 1.0,
        },
        run_with_part,
    ),
    "Beam with a free curve": WorkingCall(
        lambda box: {
            "name": "strip",
            "curve": box.curve,
            "section": box.section,
            "elements": 1,
            "free_curve": box.curve,
        },
        run_with_part,
    ),
    "welded_beams": WorkingCall(
        lambda box: {
            "mechanism": box.mech,
            "name": "strip",
            "curve": bd.Line((0.0, 1.0), (1.0, 1.0)),
            "section": box.section,
            "bodies": 2,
            "closed": False,
            "elements": 1,
        },
        lambda box, result: box.run(),
    ),
    "frame": WorkingCall(
        lambda box: {
            "mechanism": box.mech,
            "name": "rack",
            "points": {"A": (0.0, 1.0), "B": (1.0, 1.0), "C": (1.0, 2.0)},
            "members": ("AB", "BC"),
            "section": box.section,
            "elements": 1,
        },
        lambda box, result: box.run(),
    ),
}

NUMBER_CALLS: dict[str, WorkingCall] = {
    "Curve of points": WorkingCall(
        lambda box: {"points": [(0.0, 0.0), (1.0, 0.1), (2.0, 0.1), (3.0, 0.0)], "noise": 1e-3},
        run_with_curve,
    ),
    "Section.rectangle": WorkingCall(
        lambda box: {"material": box.material, "width": 0.02, "height": 0.004, "damping": 0.0},
        run_with_section,
    ),
    "Section.circle": WorkingCall(
        lambda box: {"material": box.material, "diameter": 0.01, "damping": 0.0}, run_with_section
    ),
    "Section.pipe": WorkingCall(
        lambda box: {"material": box.material, "diameter": 0.01, "wall": 0.001, "damping": 0.0},
        run_with_section,
    ),
    "Section.i_profile": WorkingCall(
        lambda box: {
            "material": box.material,
            "width": 0.02,
            "height": 0.04,
            "flange": 0.002,
            "web": 0.001,
        },
        run_with_section,
    ),
    "piecewise": WorkingCall(
        lambda box: {"end": 0.005, "law": 1.0, "last": 0.0},
        run_with_law,
        call=lambda box, end, law, last: bd.piecewise((end, law), last),
    ),
    "piecewise entry": WorkingCall(
        lambda box: {"piece": (0.005, 1.0)},
        run_with_law,
        call=lambda box, piece: bd.piecewise(piece, 0.0),
    ),
}

MECHANISM_CALLS: dict[str, WorkingCall] = {
    "Mechanism": WorkingCall(
        lambda box: {"gravity": (0.0, -9.81), "start": "as drawn", "redundant": "refuse"},
        _run_with_falling_body,
    ),
    "Mechanism.add": WorkingCall(
        lambda box: {"part": bd.RigidBody("disk", 1.0, 0.1)},
        lambda box, result: box.run(),
        on=lambda box: box.mech,
    ),
    "Mechanism.observe": WorkingCall(
        lambda box: {"name": "watched", "what": box.bar.at(0.0, 0.0)},
        call=_run_with_observable_named,
    ),
    "Mechanism.part": WorkingCall(lambda box: {"name": "bar"}, on=lambda box: box.mech),
    "ground.at": WorkingCall(
        lambda box: {"x": 3.0, "y": 0.0}, _run_with_pin_at, on=lambda box: box.mech.ground
    ),
    "RigidBody.at": WorkingCall(
        lambda box: {"x": 1.0, "y": 0.0}, run_with_mass_at, on=lambda box: box.bar
    ),
    "Beam.at": WorkingCall(lambda box: {"s": 0.5}, run_with_mass_at, on=lambda box: box.beam),
    "Beam.strain": WorkingCall(
        lambda box: {"s": 0.5, "offset": 1e-3}, run_with_observable, on=lambda box: box.beam
    ),
    "Beam.stress": WorkingCall(
        lambda box: {"s": 0.5, "offset": "top"}, run_with_observable, on=lambda box: box.beam
    ),
    "LineSurface.gap": WorkingCall(
        lambda box: {"point": box.bar.at(*KNEE)}, run_with_observable, on=lambda box: box.floor
    ),
    "Beam.largest_stress": WorkingCall(
        lambda box: {"s": [0.2, 0.5], "exponent": 50.0},
        run_with_observable,
        on=lambda box: box.beam,
    ),
    "Beam.section_forces": WorkingCall(
        lambda box: {"s": 0.5}, run_with_observable, on=lambda box: box.beam
    ),
    "Beam.deflection": WorkingCall(
        lambda box: {"s": 1.0, "reference": 0.0}, run_with_observable, on=lambda box: box.beam
    ),
    "Beam.deformation": WorkingCall(
        lambda box: {"s": 0.5, "axes": "local"}, run_with_observable, on=lambda box: box.beam
    ),
    "equations_of_motion": WorkingCall(
        lambda box: {"mechanism": box.mech, "start": "as drawn"}, Sandbox.run
    ),
}


def evaluate_objective(sandbox: Sandbox, objective: bd.results.Objective) -> list[float]:
    """Return the values of the terms of an objective for a column that increases with time."""
    values, t = [], np.linspace(0.0, 1.0, 11)
    grid = SampleGrid(t, np.full(len(t), 1.0 / len(t)), 0.0, 1.0)
    for factor, term in (2.0 * objective).terms:
        times = term.sample_times(grid)
        values.append(factor * term.evaluate(times, grid.weights)[0])
    return values


# Functions that use the result of a call, by heading or page of the reference.
_USES: dict[str, Callable[[Sandbox, Any], Any]] = {
    "Bodies": run_with_part,
    "Joints": run_with_part,
    "Drivers": run_with_part,
    "Loads and forces": run_with_part,
    "Time laws": run_with_law,
    "Observables": run_with_observable,
    "beams": run_with_curve,
    "sections": run_with_section,
    "Gradients": evaluate_objective,
    "Optimization": lambda sandbox, quantity: (2.0 * quantity).label,
}
_OTHER_USES: dict[str, Callable[[Sandbox, Any], Any] | None] = {
    "Beam": run_with_part,
    "CircleSurface": None,
    "LineSurface": None,
    "Material": lambda sandbox, material: run_with_section(
        sandbox, bd.Section(material, 8e-5, 1e-10)
    ),
}


def _slider_on_rail(sandbox: Sandbox) -> bd.PointOnLine:
    slider = sandbox.mech.add(bd.RigidBody("slider", 1.0, 0.1, (3.0, 0.0)))
    ends = sandbox.mech.ground.at(3.0, 0.0), slider.at(3.0, 0.0)
    return sandbox.mech.add(bd.PointOnLine("rail", *ends, direction=(1.0, 0.0)))


def _spring_arguments(sandbox: Sandbox, **law: Any) -> dict[str, Any]:
    ends = {"a": sandbox.ground.at(1.1, 0.2), "b": sandbox.disk.at(0.1, 0.2)}
    return {"name": "spring"} | ends | law


def _force(x: Any, rate: Any) -> Any:
    return 2.0 * x + 0.1 * rate


def _energy(x: Any) -> Any:
    return x**2


def _bushing_force(x: Any, rate: Any) -> Any:
    return (2.0 * x[0], x[1], x[2])


def _bushing_energy(x: Any) -> Any:
    return x[0] ** 2 + 0.5 * x[1] ** 2 + 0.5 * x[2] ** 2


PART_CALLS: dict[str, WorkingCall] = {
    public.name: WorkingCall(
        SAMPLES[public.name], _OTHER_USES.get(public.name, _USES.get(group.heading or group.page))
    )
    for group in catalog.GROUPS
    for public in group.names
    if public.name in SAMPLES
} | {
    "Friction in a guide": WorkingCall(
        lambda box: {
            "name": "friction",
            "joint": _slider_on_rail(box),
            "coefficient": 0.2,
            "friction_speed": 0.1,
        },
        run_with_part,
    ),
    "Bushing of a law": WorkingCall(
        lambda box: _spring_arguments(box, law=_bushing_force, energy=_bushing_energy),
        run_with_part,
    ),
    "Spring of a law": WorkingCall(
        lambda box: _spring_arguments(box, law=_force, energy=_energy), run_with_part
    ),
    "TorsionSpring of a law": WorkingCall(
        lambda box: _spring_arguments(box, law=_force, energy=_energy), run_with_part
    ),
}


def _system_arguments(sandbox: Sandbox) -> dict[str, Any]:
    _, q, v = sandbox.symbols
    lam, m = ca.SX.sym("lam"), ca.SX.sym("m")
    return sandbox.circle | {
        "mass": ca.vertcat(m, m),
        "force": ca.vertcat(-0.1 * v[0] - 2.0 * q[0], -0.1 * v[1] - 9.81 * m),
        "lam": lam,
        "parameters": {m: 2.0},
        "strain_energy": q[0] ** 2,
        "gravity_energy": 9.81 * m * q[1],
        "dissipated_power": 0.1 * ca.dot(v, v),
        "names": ("x", "y"),
        "units": ("m", "m"),
        "observe": {"radius": ca.dot(q, q), "tension [N/m]": lam},
        "breakpoints": (0.005,),
        "time_scale": 1.0,
        "scales": [1.0, 1.0],
        "events": (bd.Event("x", 5.0, name="event"),),
    }


def _sleigh_arguments(sandbox: Sandbox) -> dict[str, Any]:
    t, q, v = sandbox.symbols
    return {
        "t": t,
        "q": q,
        "v": v,
        "mass": [1.0, 1.0],
        "force": [1.0, 0.0],
        "velocity_constraints": {"side [N]": v[1] - t * v[0]},
        "q0": [0.0, 0.0],
        "v0": [1.0, 0.0],
    }


def _make_system_with_parameter(sandbox: Sandbox, m: Any) -> bd.ConstrainedSystem:
    arguments = _system_arguments(sandbox)
    return bd.ConstrainedSystem(
        **arguments | {"parameters": dict.fromkeys(arguments["parameters"], m)}
    )


SYSTEM_CALLS: dict[str, WorkingCall] = {
    "ConstrainedSystem": WorkingCall(_system_arguments, Sandbox.run),
    "ConstrainedSystem of velocities": WorkingCall(_sleigh_arguments, Sandbox.run),
    "ConstrainedSystem of a parameter": WorkingCall(
        lambda box: {"m": 2.0},
        Sandbox.run,
        call=_make_system_with_parameter,
    ),
    "Event": WorkingCall(
        lambda box: {"what": "x", "crosses": 5.0, "direction": "up", "do": "stop", "name": "event"},
        lambda box, event: box.run(
            bd.ConstrainedSystem(**(_system_arguments(box) | {"events": [event]}))
        ),
    ),
}
