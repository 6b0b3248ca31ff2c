"""Working calls of systems of constrained mechanics, and of what is watched for in them."""

from __future__ import annotations

from typing import Any

import casadi as ca

import beamdae as bd
from robustness.world import Base, World


def _constrained(world: World) -> dict[str, Any]:
    _, q, v = world.symbols
    lam, m = ca.SX.sym("lam"), ca.SX.sym("m")
    return world.circle | {
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


def _sleigh(world: World) -> dict[str, Any]:
    t, q, v = world.symbols
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


def _with_parameter(world: World, m: Any) -> bd.ConstrainedSystem:
    given = _constrained(world)
    return bd.ConstrainedSystem(**given | {"parameters": dict.fromkeys(given["parameters"], m)})


SYSTEMS: dict[str, Base] = {
    "ConstrainedSystem": Base(_constrained, lambda w, system: w.run(system)),
    "ConstrainedSystem of velocities": Base(
        _sleigh,
        lambda w, system: w.run(system),
    ),
    "ConstrainedSystem of a parameter": Base(
        lambda w: {"m": 2.0}, lambda w, system: w.run(system), _with_parameter
    ),
    "Event": Base(
        lambda w: {"what": "x", "crosses": 5.0, "direction": "up", "do": "stop", "name": "event"},
        lambda w, event: w.run(bd.ConstrainedSystem(**(_constrained(w) | {"events": [event]}))),
    ),
}
