"""Sample call of each public part, law and objective, and the mechanism for these calls."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

import beamdae as bd


class SampleMechanism:
    """Mechanism with a disk, a beam and a hinge, each added when it is first accessed.

    Attributes
    ----------
    mechanism
        The mechanism, under gravity of 9.81 m/s^2.
    """

    def __init__(self) -> None:
        self.mechanism = bd.Mechanism(gravity=(0.0, -9.81))

    @property
    def ground(self):
        """Ground of the mechanism, without coordinates."""
        return self.mechanism.ground

    @cached_property
    def disk(self) -> bd.RigidBody:
        """Rigid body of 1 kg and 0.1 kg m^2 with its center of mass at (0.5, 0.4) m."""
        return self.mechanism.add(bd.RigidBody("disk", 1.0, 0.1, (0.5, 0.4)))

    @cached_property
    def beam(self) -> bd.Beam:
        """Beam of one element along `curve`."""
        return self.mechanism.add(bd.Beam("beam", self.curve, self.section, elements=1))

    @cached_property
    def hinge(self) -> bd.Joint:
        """Hinge between the ground and the disk at the origin."""
        ends = self.ground.at(0.0, 0.0), self.disk.at(0.0, 0.0)
        return self.mechanism.add(bd.Revolute("hinge", *ends))

    @cached_property
    def floor(self) -> bd.LineSurface:
        """Horizontal surface at y = -0.1 m."""
        return bd.LineSurface(self.ground.at(0.0, -0.1))

    @cached_property
    def curve(self) -> bd.Curve:
        """Arc of 1 m length and 1 m radius that starts at (0, 1) m."""
        return bd.Arc(1.0, 1.0, start=(0.0, 1.0))

    @cached_property
    def material(self) -> bd.Material:
        """Steel with a Young's modulus of 210 GPa and a density of 7850 kg/m^3."""
        return bd.Material(E=2.1e11, nu=0.3, rho=7850.0)

    @cached_property
    def section(self) -> bd.Section:
        """Steel rectangle of 20 mm width and 4 mm height."""
        return bd.Section.rectangle(self.material, width=0.02, height=0.004)


def _joint_arguments(m: Any) -> dict[str, Any]:
    """Return the arguments of a joint between coinciding points of the ground and the disk."""
    return {"name": "joint", "a": m.ground.at(0.1, 0.2), "b": m.disk.at(0.1, 0.2)}


def _spring_arguments(m: Any) -> dict[str, Any]:
    """Return the arguments of a force element between distant points of the ground and the disk."""
    return {"name": "spring", "a": m.ground.at(1.1, 0.2), "b": m.disk.at(0.1, 0.2)}


def _path_arguments() -> dict[str, Any]:
    """Return arguments of an equilibrium path."""
    return {"loads": None, "control": "load", "step": 0.1, "t": 0.0}


def _run_up(t: Any) -> Any:
    return 0.3 * t**2


def _push(point: Any, t: Any) -> Any:
    return (1.0 - point.velocity[0], 0.0)


def _potential(point: Any) -> Any:
    return 0.5 * point.position[0] ** 2


# Two masses on a spring along x.
_ROD = np.kron([[100.0, -100.0], [-100.0, 100.0]], [[1.0, 0.0], [0.0, 0.0]])

# Functions that return keyword arguments of a valid call, by public name. Tests of parts, error
# messages and robustness start from these calls.


def find_public(name):
    """Return the object of a public name, in whichever package it is."""
    packages = (bd, bd.quantities, bd.results)
    return next((getattr(x, name) for x in packages if name in x.__all__), None)


SAMPLES: dict[str, Callable[[SampleMechanism], dict[str, Any]]] = {
    "RigidBody": lambda m: {
        "name": "body",
        "mass": 1.0,
        "inertia": 0.1,
        "center": (3.0, 0.0),
        "velocity": (0.0, 0.0),
        "angular_velocity": 0.0,
        "shape": ((2.9, 0.0), (3.1, 0.0), (3.0, 0.1)),
    },
    "PointMass": lambda m: {"name": "mass", "mass": 0.1, "at": (2.0, 0.0), "velocity": (0.0, 0.0)},
    "ReducedBody": lambda m: {
        "name": "rod",
        "mass": np.eye(4),
        "stiffness": _ROD,
        "nodes": [(3.0, 0.0), (4.0, 0.0)],
        "shapes": [[-1.0], [0.0], [1.0], [0.0]],
        "damping": 0.01,
        "velocity": (0.0, 0.0),
        "angular_velocity": 0.0,
    },
    "Revolute": _joint_arguments,
    "Weld": _joint_arguments,
    "Prismatic": lambda m: _joint_arguments(m) | {"direction": (1.0, -0.5)},
    "PointOnLine": lambda m: _joint_arguments(m) | {"direction": (1.0, -0.5)},
    "Distance": lambda m: {
        "name": "link",
        "a": m.ground.at(1.1, 0.2),
        "b": m.disk.at(0.1, 0.2),
        "length": 1.0,
    },
    "SlidingOnBeam": lambda m: {
        "name": "slider",
        "a": m.disk.at(*m.beam.start.point),
        "beam": m.beam,
        "ends": "record",
    },
    "Gear": lambda m: _joint_arguments(m) | {"ratio": -0.5, "carrier": m.beam.start},
    "RackAndPinion": lambda m: {
        "name": "rack",
        "a": m.disk.at(0.5, 0.4),
        "b": m.beam.start,
        "radius": 0.3,
        "direction": (1.0, 0.2),
    },
    "RollingOnLine": lambda m: {
        "name": "wheel",
        "a": m.ground.at(0.5, -0.1),
        "b": m.disk.at(0.5, 0.4),
        "radius": 0.5,
        "direction": (1.0, 0.0),
    },
    "RollingOnCircle": lambda m: {
        "name": "wheel",
        "a": m.ground.at(0.5, -1.1),
        "b": m.disk.at(0.5, 0.4),
        "radii": (1.0, 0.5),
    },
    "Skate": lambda m: {"name": "blade", "on": m.disk.at(0.1, 0.2), "direction": (1.0, -0.3)},
    "Driver": lambda m: _joint_arguments(m) | {"law": _run_up},
    "TranslationalDriver": lambda m: (
        _joint_arguments(m) | {"law": _run_up, "direction": (1.0, 0.0)}
    ),
    "Force": lambda m: {
        "name": "load",
        "on": m.disk.at(0.1, 0.2),
        "law": (1.0, 0.0),
        "axes": "body",
    },
    "Moment": lambda m: {
        "name": "load",
        "on": m.disk.at(0.1, 0.2),
        "law": 1.0,
        "reaction_on": m.beam.start,
    },
    "DistributedForce": lambda m: {
        "name": "load",
        "beam": m.beam,
        "law": (0.0, 1.0),
        "axes": "section",
    },
    "MovingForce": lambda m: {
        "name": "load",
        "beam": m.beam,
        "force": (0.0, 1.0),
        "speed": 1.0,
        "start": 0.0,
    },
    "Spring": lambda m: (
        _spring_arguments(m)
        | {"stiffness": 2.0, "damping": 0.1, "free_length": 0.9, "preload": 0.1}
    ),
    "TorsionSpring": lambda m: (
        _spring_arguments(m) | {"stiffness": 2.0, "damping": 0.1, "free_angle": 0.1, "preload": 0.1}
    ),
    "Bushing": lambda m: (
        _spring_arguments(m)
        | {
            "kx": 2.0,
            "ky": 1.0,
            "ktheta": 0.3,
            "cx": 0.1,
            "cy": 0.1,
            "ctheta": 0.1,
            "angle": 0.2,
        }
    ),
    "Contact": lambda m: {
        "name": "stop",
        "point": m.disk.at(0.1, 0.2),
        "surface": m.floor,
        "stiffness": 1e4,
        "exponent": 1.5,
        "restitution": 0.5,
        "impact_speed": 1.0,
        "friction": 0.1,
        "friction_speed": 0.1,
        "max_step": 0.01,
        "static": 0.2,
        "stribeck": 0.3,
    },
    "BeamContact": lambda m: {
        "name": "strip contact",
        "beam": m.beam,
        "surface": m.floor,
        "stiffness": 1e4,
        "start": 0.1,
        "end": 0.9,
        "exponent": 1.5,
        "restitution": 0.5,
        "impact_speed": 1.0,
        "friction": 0.1,
        "friction_speed": 0.1,
        "static": 0.2,
        "stribeck": 0.3,
    },
    "LineSurface": lambda m: {"on": m.ground.at(0.0, 0.0), "direction": (1.0, 0.0)},
    "CircleSurface": lambda m: {"on": m.ground.at(0.0, 9.0), "radius": 1.0, "side": "outside"},
    "Friction": lambda m: {
        "name": "friction",
        "joint": m.hinge,
        "coefficient": 0.2,
        "friction_speed": 0.1,
        "static": 0.3,
        "stribeck": 0.5,
        "radius": 0.02,
        "smoothing": 1e-3,
    },
    "RayleighDamping": lambda m: {"name": "oil", "beam": m.beam, "mass": 0.1, "stiffness": 1e-5},
    "AirDrag": lambda m: {"name": "drag", "beam": m.beam, "coefficient": 0.1},
    "StandardLinearSolid": lambda m: {
        "name": "relaxation",
        "beam": m.beam,
        "ratio": 0.5,
        "relaxation_time": 0.01,
    },
    "ForceLaw": lambda m: {
        "name": "load",
        "on": m.disk.at(0.1, 0.2),
        "law": _push,
        "energy": _potential,
        "dissipative": False,
    },
    "Law": lambda m: {
        "pieces": (lambda t: t, lambda t: 0.0),
        "breakpoints": (0.005,),
        "time_scale": 1.0,
        "ranges": (),
    },
    "run_up": lambda m: {"speed": 1.0, "duration": 0.1},
    "sine": lambda m: {"amplitude": 1.0, "frequency": 50.0, "phase": 0.0},
    "half_sine": lambda m: {"peak": 1.0, "duration": 0.011, "start": 0.002},
    "table": lambda m: {
        "x": [0.0, 0.004, 0.01, 0.02],
        "y": [0.0, 1.0, 0.0, 1.0],
        "kind": "linear",
        "outside": "hold",
        "name": "pulse",
    },
    "acceleration": lambda m: {"of": m.disk.at(0.1, 0.2), "axes": "section"},
    "relative_displacement": lambda m: {
        "of": m.disk.at(0.1, 0.2),
        "on": m.ground.at(0.0, 0.0),
        "axes": "section",
    },
    "relative_motion": lambda m: {
        "of": m.disk.at(0.1, 0.2),
        "on": m.ground.at(0.0, 0.0),
        "axes": "section",
    },
    "Beam": lambda m: {
        "name": "strip",
        "curve": m.curve,
        "section": m.section,
        "elements": 1,
        "strain": "green",
        "formulation": "floating frame",
        "elements_shape": "curved",
        "continuity": "cartesian",
        "nodes": 4,
        "quadrature": "reduced",
        "frame": "chord",
        "velocity": (0.0, 0.0),
        "angular_velocity": 0.0,
        "kinematics": None,
        "free_curve": m.curve,
    },
    "Line": lambda m: {"start": (0.0, 1.0), "end": (1.0, 1.0)},
    "Arc": lambda m: {"radius": 1.0, "length": 1.0, "start": (0.0, 1.0), "angle": 0.1},
    "Parabola": lambda m: {"span": 1.0, "rise": 0.1, "start": (0.0, 1.0), "angle": 0.1},
    "Curve": lambda m: {"function": lambda x: 0.1 * x**2, "x": (0.0, 1.0)},
    "IntrinsicCurve": lambda m: {
        "law": lambda s: 0.1 * s,
        "length": 1.0,
        "start": (0.0, 1.0),
        "angle": 0.1,
    },
    "Segment": lambda m: {"curve": m.curve, "start": 0.1, "end": 0.9},
    "Section": lambda m: {
        "material": m.material,
        "area": 8e-5,
        "second_moment": 1e-10,
        "shear_coefficient": 0.8,
        "damping": 1e-5,
        "mass_per_length": 0.6,
        "rotary_inertia_per_length": 1e-6,
        "shear_peak": 1.5,
        "shapes": (),
    },
    "taper": lambda m: {
        "shape": type(m.section).circle,
        "material": m.material,
        "diameter": (0.01, 0.02),
    },
    "Material": lambda m: {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "yield_stress": 235e6},
    "EndValue": lambda m: {"column": "tip.y"},
    "TimeIntegral": lambda m: {"column": "tip.y", "power": 2},
    "SmoothMaximum": lambda m: {"column": "tip.y", "exponent": 20.0},
    "SquaredErrors": lambda m: {
        "column": "tip.y",
        "times": (0.1, 0.2),
        "values": (0.0, 0.5),
        "sigma": 0.1,
    },
    "Frequency": lambda m: {"number": 1, "about": "equilibrium"},
    "EquilibriumValue": lambda m: {"column": "tip.y", "to": 1.0, **_path_arguments()},
    "EquilibriumErrors": lambda m: {
        "column": "tip.y",
        "to": (0.5, 1.0),
        "values": (0.0, 0.5),
        "sigma": 0.1,
        **_path_arguments(),
    },
    "CriticalLoad": lambda m: {"to": 10.0, "number": 1, **_path_arguments()},
    "ParameterFunction": lambda m: {
        "function": lambda **parameters: 1.0,
        "name": "cost",
        "unit": "kg",
    },
}
