"""Catalog of the public names, with one entry per name.

To add a public part, integrator or function, write a module and add an entry here. The catalog is
read by `beamdae.__init__` (lazy imports), `python beamdae/catalog.py` (the type stub
`__init__.pyi`), the command line (names of integrators) and the pages of the reference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Public:
    """Public name `bd.<name>` and the module from which it is imported.

    Attributes
    ----------
    name
        The public name.
    module
        Dotted path of the module or package from which the name is imported.
    sample
        Function that returns keyword arguments of a valid call, given a
        `beamdae.testing.SampleMechanism`. Tests of parts, error messages and robustness start from
        this call. None if there is no sample.
    command
        Name of an integrator on the command line, as in `--integrator ida`; otherwise empty.
    """

    name: str
    module: str
    sample: Callable[[Any], dict[str, Any]] | None = None
    command: str = ""


@dataclass(frozen=True)
class Group:
    """Public names that are listed together on one page of the reference.

    Attributes
    ----------
    page
        File name of the page without its suffix.
    heading
        Heading above the names; empty for a page without headings.
    names
        The public names, in the order of the page.
    """

    page: str
    heading: str
    names: tuple[Public, ...]


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


# Title and opening sentence of each page of the reference, in reading order.
PAGES = {
    "mechanism": (
        "Mechanism and model",
        "Mechanisms of parts, systems of equations given as expressions, and model functions.",
    ),
    "parts": ("Parts", "Bodies, joints, drivers, forces, time laws, observables and events."),
    "beams": ("Beams and curves", "Beams, the curves of their axes, and frames of several beams."),
    "sections": ("Sections and materials", "Cross-sections and materials of beams."),
    "integrators": ("Integrators", "Simulation of a mechanism, and the available integrators."),
    "results": ("Results", "Results of a run: tables, section forces, files and pictures."),
    "analysis": (
        "Analysis",
        "Equilibria, natural modes, linear models and periodic motions of a mechanism.",
    ),
    "studies": (
        "Studies and sweeps",
        "Studies, sweeps, and the comparison of runs with references.",
    ),
    "checks": (
        "Checks and verification",
        "Checks of a mechanism before a run, error estimates after a run, and certificates.",
    ),
    "errors": ("Errors and warnings", "Exceptions and warnings of beamdae."),
}

GROUPS = (
    Group(
        "mechanism",
        "",
        (
            Public("Mechanism", "beamdae.parts.mechanism"),
            Public("Attachment", "beamdae.parts.attachments"),
            Public("Part", "beamdae.parts.part"),
            Public("model", "beamdae.model_functions"),
            Public("Model", "beamdae.model_functions"),
            Public("param", "beamdae.model_parameters"),
            Public("load_model", "beamdae.cli.model_files.model_file"),
            Public("ConstrainedSystem", "beamdae.equations.assembly.constrained_system"),
            Public("equations_of_motion", "beamdae.equations.assembly.assemble"),
            Public("EquationsOfMotion", "beamdae.equations.equations_of_motion"),
        ),
    ),
    Group(
        "parts",
        "Bodies",
        (
            Public(
                "RigidBody",
                "beamdae.parts.bodies.rigid_body",
                lambda m: {
                    "name": "body",
                    "mass": 1.0,
                    "inertia": 0.1,
                    "center": (3.0, 0.0),
                    "velocity": (0.0, 0.0),
                    "angular_velocity": 0.0,
                    "shape": ((2.9, 0.0), (3.1, 0.0), (3.0, 0.1)),
                },
            ),
            Public(
                "PointMass",
                "beamdae.parts.bodies.point_mass",
                lambda m: {"name": "mass", "mass": 0.1, "at": (2.0, 0.0), "velocity": (0.0, 0.0)},
            ),
        ),
    ),
    Group(
        "parts",
        "Joints",
        (
            Public("Joint", "beamdae.parts.joints.joint"),
            Public(
                "Revolute",
                "beamdae.parts.joints.joint",
                _joint_arguments,
            ),
            Public(
                "Weld",
                "beamdae.parts.joints.joint",
                _joint_arguments,
            ),
            Public(
                "Prismatic",
                "beamdae.parts.joints.guides",
                lambda m: _joint_arguments(m) | {"direction": (1.0, -0.5)},
            ),
            Public(
                "PointOnLine",
                "beamdae.parts.joints.guides",
                lambda m: _joint_arguments(m) | {"direction": (1.0, -0.5)},
            ),
            Public(
                "Distance",
                "beamdae.parts.joints.distance",
                lambda m: {
                    "name": "link",
                    "a": m.ground.at(1.1, 0.2),
                    "b": m.disk.at(0.1, 0.2),
                    "length": 1.0,
                },
            ),
            Public(
                "SlidingOnBeam",
                "beamdae.beams.sliding",
                lambda m: {
                    "name": "slider",
                    "a": m.disk.at(*m.beam.start.point),
                    "beam": m.beam,
                    "ends": "record",
                },
            ),
            Public(
                "Gear",
                "beamdae.parts.joints.gears",
                lambda m: _joint_arguments(m) | {"ratio": -0.5, "carrier": m.beam.start},
            ),
            Public(
                "RackAndPinion",
                "beamdae.parts.joints.gears",
                lambda m: {
                    "name": "rack",
                    "a": m.disk.at(0.5, 0.4),
                    "b": m.beam.start,
                    "radius": 0.3,
                    "direction": (1.0, 0.2),
                },
            ),
            Public(
                "RollingOnLine",
                "beamdae.parts.joints.rolling",
                lambda m: {
                    "name": "wheel",
                    "a": m.ground.at(0.5, -0.1),
                    "b": m.disk.at(0.5, 0.4),
                    "radius": 0.5,
                    "direction": (1.0, 0.0),
                },
            ),
            Public(
                "RollingOnCircle",
                "beamdae.parts.joints.rolling",
                lambda m: {
                    "name": "wheel",
                    "a": m.ground.at(0.5, -1.1),
                    "b": m.disk.at(0.5, 0.4),
                    "radii": (1.0, 0.5),
                },
            ),
            Public(
                "Skate",
                "beamdae.parts.joints.rolling",
                lambda m: {"name": "blade", "on": m.disk.at(0.1, 0.2), "direction": (1.0, -0.3)},
            ),
        ),
    ),
    Group(
        "parts",
        "Drivers",
        (
            Public(
                "Driver",
                "beamdae.parts.joints.drivers",
                lambda m: _joint_arguments(m) | {"law": _run_up},
            ),
            Public(
                "TranslationalDriver",
                "beamdae.parts.joints.drivers",
                lambda m: _joint_arguments(m) | {"law": _run_up, "direction": (1.0, 0.0)},
            ),
        ),
    ),
    Group(
        "parts",
        "Loads and forces",
        (
            Public(
                "Force",
                "beamdae.parts.forces.loads",
                lambda m: {
                    "name": "load",
                    "on": m.disk.at(0.1, 0.2),
                    "law": (1.0, 0.0),
                    "axes": "body",
                },
            ),
            Public(
                "Moment",
                "beamdae.parts.forces.loads",
                lambda m: {"name": "load", "on": m.disk.at(0.1, 0.2), "law": 1.0},
            ),
            Public(
                "DistributedForce",
                "beamdae.beams.beam_loads",
                lambda m: {"name": "load", "beam": m.beam, "law": (0.0, 1.0), "axes": "section"},
            ),
            Public(
                "MovingForce",
                "beamdae.beams.beam_loads",
                lambda m: {
                    "name": "load",
                    "beam": m.beam,
                    "force": (0.0, 1.0),
                    "speed": 1.0,
                    "start": 0.0,
                },
            ),
            Public(
                "Spring",
                "beamdae.parts.forces.springs",
                lambda m: (
                    _spring_arguments(m) | {"stiffness": 2.0, "free_length": 0.9, "preload": 0.1}
                ),
            ),
            Public(
                "Damper",
                "beamdae.parts.forces.springs",
                lambda m: _spring_arguments(m) | {"damping": 0.1},
            ),
            Public(
                "SpringDamper",
                "beamdae.parts.forces.springs",
                lambda m: (
                    _spring_arguments(m)
                    | {"stiffness": 2.0, "damping": 0.1, "free_length": 0.9, "preload": 0.1}
                ),
            ),
            Public(
                "TorsionSpring",
                "beamdae.parts.forces.springs",
                lambda m: (
                    _spring_arguments(m)
                    | {"stiffness": 2.0, "damping": 0.1, "free_angle": 0.1, "preload": 0.1}
                ),
            ),
            Public(
                "TorsionDamper",
                "beamdae.parts.forces.springs",
                lambda m: _spring_arguments(m) | {"damping": 0.1},
            ),
            Public(
                "Bushing",
                "beamdae.parts.forces.bushing",
                lambda m: (
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
            ),
            Public(
                "Contact",
                "beamdae.parts.forces.contact",
                lambda m: {
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
            ),
            Public(
                "LineSurface",
                "beamdae.parts.forces.surfaces",
                lambda m: {"on": m.ground.at(0.0, 0.0), "direction": (1.0, 0.0)},
            ),
            Public(
                "CircleSurface",
                "beamdae.parts.forces.surfaces",
                lambda m: {"on": m.ground.at(0.0, 9.0), "radius": 1.0, "side": "outside"},
            ),
            Public(
                "Friction",
                "beamdae.parts.forces.friction",
                lambda m: {
                    "name": "friction",
                    "joint": m.hinge,
                    "coefficient": 0.2,
                    "friction_speed": 0.1,
                    "static": 0.3,
                    "stribeck": 0.5,
                    "radius": 0.02,
                    "smoothing": 1e-3,
                },
            ),
            Public(
                "RayleighDamping",
                "beamdae.beams.damping",
                lambda m: {"name": "oil", "beam": m.beam, "mass": 0.1, "stiffness": 1e-5},
            ),
            Public(
                "AirDrag",
                "beamdae.beams.damping",
                lambda m: {"name": "drag", "beam": m.beam, "coefficient": 0.1},
            ),
            Public(
                "ForceLaw",
                "beamdae.parts.forces.force_law",
                lambda m: {
                    "name": "load",
                    "on": m.disk.at(0.1, 0.2),
                    "law": _push,
                    "energy": _potential,
                    "dissipative": False,
                },
            ),
            Public(
                "positive_part",
                "beamdae.parts.forces.smooth",
                lambda m: {"x": 1.0},
            ),
            Public(
                "smooth_sign",
                "beamdae.parts.forces.smooth",
                lambda m: {"x": 1.0, "scale": 1.0},
            ),
        ),
    ),
    Group(
        "parts",
        "Time laws",
        (
            Public(
                "Law",
                "beamdae.parts.laws",
                lambda m: {
                    "pieces": (lambda t: t, lambda t: 0.0),
                    "breakpoints": (0.005,),
                    "time_scale": 1.0,
                    "ranges": (),
                },
            ),
            Public(
                "run_up",
                "beamdae.parts.laws",
                lambda m: {"speed": 1.0, "duration": 0.1},
            ),
            Public(
                "sine",
                "beamdae.parts.laws",
                lambda m: {"amplitude": 1.0, "frequency": 50.0, "phase": 0.0},
            ),
            Public("piecewise", "beamdae.parts.laws"),
            Public(
                "table",
                "beamdae.parts.tables",
                lambda m: {
                    "x": [0.0, 0.004, 0.01, 0.02],
                    "y": [0.0, 1.0, 0.0, 1.0],
                    "kind": "linear",
                    "outside": "hold",
                    "name": "pulse",
                },
            ),
            Public("table_from_csv", "beamdae.parts.tables"),
        ),
    ),
    Group(
        "parts",
        "Observables",
        (
            Public(
                "acceleration",
                "beamdae.parts.observables",
                lambda m: {"of": m.disk.at(0.1, 0.2), "axes": "section"},
            ),
            Public(
                "relative_displacement",
                "beamdae.parts.observables",
                lambda m: {
                    "of": m.disk.at(0.1, 0.2),
                    "on": m.ground.at(0.0, 0.0),
                    "axes": "section",
                },
            ),
            Public(
                "relative_motion",
                "beamdae.parts.observables",
                lambda m: {
                    "of": m.disk.at(0.1, 0.2),
                    "on": m.ground.at(0.0, 0.0),
                    "axes": "section",
                },
            ),
        ),
    ),
    Group(
        "parts",
        "Inputs, states and controllers",
        (
            Public("Input", "beamdae.parts.signals"),
            Public("Sensor", "beamdae.parts.signals"),
            Public("State", "beamdae.parts.signals"),
            Public("low_pass", "beamdae.parts.control.blocks"),
            Public("transfer_function", "beamdae.parts.control.blocks"),
            Public("pid", "beamdae.parts.control.blocks"),
            Public("Controller", "beamdae.parts.control.controller"),
            Public("Sample", "beamdae.parts.control.controller"),
        ),
    ),
    Group(
        "parts",
        "Events",
        (
            Public("Event", "beamdae.parts.events"),
            Public("activate", "beamdae.parts.event_actions"),
            Public("deactivate", "beamdae.parts.event_actions"),
            Public("change_law", "beamdae.parts.event_actions"),
            Public("impact", "beamdae.parts.event_actions"),
        ),
    ),
    Group(
        "beams",
        "",
        (
            Public(
                "Beam",
                "beamdae.beams.beam",
                lambda m: {
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
            ),
            Public("welded_beams", "beamdae.beams.structures"),
            Public("frame", "beamdae.beams.structures"),
            Public("Frame", "beamdae.beams.structures"),
            Public(
                "Line",
                "beamdae.curves.plane_curves",
                lambda m: {"start": (0.0, 1.0), "end": (1.0, 1.0)},
            ),
            Public(
                "Arc",
                "beamdae.curves.plane_curves",
                lambda m: {"radius": 1.0, "length": 1.0, "start": (0.0, 1.0), "angle": 0.1},
            ),
            Public(
                "Parabola",
                "beamdae.curves.spline_curves",
                lambda m: {"span": 1.0, "rise": 0.1, "start": (0.0, 1.0), "angle": 0.1},
            ),
            Public(
                "Curve",
                "beamdae.curves.spline_curves",
                lambda m: {"function": lambda x: 0.1 * x**2, "x": (0.0, 1.0)},
            ),
            Public(
                "IntrinsicCurve",
                "beamdae.curves.intrinsic_curve",
                lambda m: {
                    "law": lambda s: 0.1 * s,
                    "length": 1.0,
                    "start": (0.0, 1.0),
                    "angle": 0.1,
                },
            ),
            Public(
                "Segment",
                "beamdae.curves.plane_curves",
                lambda m: {"curve": m.curve, "start": 0.1, "end": 0.9},
            ),
        ),
    ),
    Group(
        "sections",
        "",
        (
            Public(
                "Section",
                "beamdae.beams.sections",
                lambda m: {
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
            ),
            Public(
                "taper",
                "beamdae.beams.sections",
                lambda m: {
                    "shape": type(m.section).circle,
                    "material": m.material,
                    "diameter": (0.01, 0.02),
                },
            ),
            Public(
                "Material",
                "beamdae.beams.materials",
                lambda m: {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "yield_stress": 235e6},
            ),
        ),
    ),
    Group(
        "integrators",
        "",
        (
            Public("simulate", "beamdae.simulation"),
            Public("Auto", "beamdae.integrators", command="auto"),
            Public("Ida", "beamdae.integrators", command="ida"),
            Public("Radau", "beamdae.integrators", command="radau"),
            Public("GeneralizedAlpha", "beamdae.integrators", command="generalized-alpha"),
            Public("Integrator", "beamdae.integrators"),
        ),
    ),
    Group(
        "results",
        "Runs",
        (
            Public("Solution", "beamdae.results.solution"),
            Public("SavedRun", "beamdae.results.storage.saved_run"),
            Public("load", "beamdae.simulation"),
            Public("SectionForces", "beamdae.results.section_forces.section_forces"),
            Public("BeamRange", "beamdae.results.diagnostics.beam_ranges"),
        ),
    ),
    Group(
        "results",
        "Pictures",
        (
            Public("draw", "beamdae.report.pictures.drawing"),
            Public("view", "beamdae.live.server"),
            Public("LiveView", "beamdae.live.server"),
            Public("plot", "beamdae.report.pictures.time_plots"),
            Public("Plot", "beamdae.results.displays"),
            Public("animate", "beamdae.report.pictures.run_animation"),
            Public("Animation", "beamdae.results.displays"),
        ),
    ),
    Group(
        "analysis",
        "Equilibria",
        (
            Public("equilibrium", "beamdae.analysis.statics.static_equilibrium"),
            Public("Equilibrium", "beamdae.results.equilibrium"),
            Public("CriticalPoint", "beamdae.results.equilibrium"),
            Public("buckling", "beamdae.analysis.statics.linear_buckling"),
            Public("Buckling", "beamdae.analysis.statics.linear_buckling"),
            Public("imperfect", "beamdae.analysis.statics.imperfections"),
            Public("knock_down", "beamdae.analysis.statics.imperfections"),
            Public("KnockDown", "beamdae.analysis.statics.imperfections"),
            Public("boundary", "beamdae.analysis.statics.boundary"),
            Public("Boundary", "beamdae.analysis.statics.boundary"),
            Public("BoundaryPoint", "beamdae.analysis.statics.boundary"),
        ),
    ),
    Group(
        "analysis",
        "Modes and linear models",
        (
            Public("modes", "beamdae.analysis.linear_dynamics.natural_modes"),
            Public("Modes", "beamdae.analysis.linear_dynamics.natural_modes"),
            Public("draw_modes", "beamdae.report.pictures.mode_shapes"),
            Public("animate_mode", "beamdae.report.pictures.mode_shapes"),
            Public("linearize", "beamdae.analysis.linear_dynamics.linear_model"),
            Public("LinearModel", "beamdae.analysis.linear_dynamics.linear_model"),
        ),
    ),
    Group(
        "analysis",
        "Steady rotation",
        (
            Public("rotation", "beamdae.parts.rotation"),
            Public("campbell", "beamdae.analysis.linear_dynamics.campbell_diagram"),
            Public("Campbell", "beamdae.analysis.linear_dynamics.campbell_diagram"),
            Public("draw_campbell", "beamdae.report.pictures.mode_shapes"),
        ),
    ),
    Group(
        "analysis",
        "Periodic motions",
        (
            Public("periodic", "beamdae.analysis.periodic.periodic_solution"),
            Public("PeriodicMotion", "beamdae.results.periodic_motion"),
            Public("frequency_response", "beamdae.analysis.periodic.periodic_continuation"),
            Public("FrequencyResponse", "beamdae.results.frequency_response"),
            Public("ResponsePoint", "beamdae.results.frequency_response"),
        ),
    ),
    Group(
        "analysis",
        "Sensitivities and fits",
        (
            Public("sensitivities", "beamdae.analysis.sensitivities.sensitivities"),
            Public("Sensitivities", "beamdae.analysis.sensitivities.sensitivities"),
            Public("equilibrium_sensitivities", "beamdae.analysis.sensitivities.statics"),
            Public("EquilibriumSensitivities", "beamdae.analysis.sensitivities.statics"),
            Public("mode_sensitivities", "beamdae.analysis.sensitivities.modes"),
            Public("ModeSensitivities", "beamdae.analysis.sensitivities.modes"),
            Public("periodic_sensitivities", "beamdae.analysis.sensitivities.periodic"),
            Public("PeriodicSensitivities", "beamdae.analysis.sensitivities.periodic"),
            Public("fit", "beamdae.analysis.fit.fit"),
            Public("Fit", "beamdae.analysis.fit.result"),
            Public("ProfileLikelihood", "beamdae.analysis.fit.profile"),
        ),
    ),
    Group(
        "analysis",
        "Gradients",
        (
            Public("gradient", "beamdae.analysis.gradients.gradients"),
            Public("Gradient", "beamdae.analysis.gradients.gradients"),
            Public("Objective", "beamdae.analysis.gradients.objectives"),
            Public(
                "EndValue",
                "beamdae.analysis.gradients.objectives",
                lambda m: {"column": "tip.y"},
            ),
            Public(
                "TimeIntegral",
                "beamdae.analysis.gradients.objectives",
                lambda m: {"column": "tip.y", "power": 2},
            ),
            Public(
                "SmoothMaximum",
                "beamdae.analysis.gradients.objectives",
                lambda m: {"column": "tip.y", "exponent": 20.0},
            ),
            Public(
                "SquaredErrors",
                "beamdae.analysis.gradients.objectives",
                lambda m: {
                    "column": "tip.y",
                    "times": (0.1, 0.2),
                    "values": (0.0, 0.5),
                    "sigma": 0.1,
                },
            ),
        ),
    ),
    Group(
        "analysis",
        "Export",
        (
            Public("export_fmu", "beamdae.export.fmu"),
            Public("ExportedFmu", "beamdae.export.fmu"),
        ),
    ),
    Group(
        "analysis",
        "Optimization",
        (
            Public("optimize", "beamdae.analysis.optimization.optimize"),
            Public("Optimization", "beamdae.analysis.optimization.result"),
            Public("at_most", "beamdae.analysis.optimization.quantities"),
            Public("at_least", "beamdae.analysis.optimization.quantities"),
            Public("Quantity", "beamdae.analysis.optimization.quantities"),
            Public("Mass", "beamdae.analysis.optimization.quantities"),
            Public(
                "Frequency",
                "beamdae.analysis.optimization.quantities",
                lambda m: {"number": 1, "about": "equilibrium"},
            ),
            Public(
                "EquilibriumValue",
                "beamdae.analysis.optimization.quantities",
                lambda m: {"column": "tip.y", "to": 1.0, **_path_arguments()},
            ),
            Public(
                "EquilibriumErrors",
                "beamdae.analysis.optimization.quantities",
                lambda m: {
                    "column": "tip.y",
                    "to": (0.5, 1.0),
                    "values": (0.0, 0.5),
                    "sigma": 0.1,
                    **_path_arguments(),
                },
            ),
            Public(
                "CriticalLoad",
                "beamdae.analysis.optimization.quantities",
                lambda m: {"to": 10.0, "number": 1, **_path_arguments()},
            ),
            Public(
                "ParameterFunction",
                "beamdae.analysis.optimization.quantities",
                lambda m: {"function": lambda **parameters: 1.0, "name": "cost"},
            ),
            Public("LargestOf", "beamdae.analysis.optimization.quantities"),
        ),
    ),
    Group(
        "studies",
        "",
        (
            Public("sweep", "beamdae.studies"),
            Public("Sweep", "beamdae.studies"),
            Public("SweepResults", "beamdae.studies"),
            Public("study", "beamdae.studies"),
            Public("Study", "beamdae.studies"),
            Public("Case", "beamdae.studies"),
            Public("grid", "beamdae.studies"),
            Public("compare", "beamdae.studies"),
        ),
    ),
    Group(
        "checks",
        "",
        (
            Public("check", "beamdae.checks"),
            Public("Check", "beamdae.checks"),
            Public("error_estimate", "beamdae.verification"),
            Public("verify", "beamdae.verification"),
            Public("certify", "beamdae.certification"),
            Public("Certificate", "beamdae.results.certificate"),
            Public("certify_equilibrium", "beamdae.analysis_certification"),
            Public("certify_modes", "beamdae.analysis_certification"),
            Public("certify_periodic", "beamdae.analysis_certification"),
            Public("AnalysisCertificate", "beamdae.results.analysis_certificate"),
        ),
    ),
    Group(
        "errors",
        "",
        (
            Public("BeamdaeError", "beamdae.errors"),
            Public("BeamdaeWarning", "beamdae.errors"),
            Public("Interrupted", "beamdae.interrupts"),
        ),
    ),
)

NAMES = {public.name: public for group in GROUPS for public in group.names}
INTEGRATORS = {public.command: public for public in NAMES.values() if public.command}


def attributes_by_module() -> dict[str, list[str]]:
    """Return the public names of each module; keys are module paths without `beamdae.`."""
    names: dict[str, list[str]] = {}
    for public in NAMES.values():
        names.setdefault(public.module.removeprefix("beamdae."), []).append(public.name)
    return names


def stub_text() -> str:
    """Return the text of the type stub `beamdae/__init__.pyi`."""
    lines = sorted(
        f"from .{module} import {name} as {name}"
        for module, names in attributes_by_module().items()
        for name in names
    )
    return "\n".join([*lines, "", "__version__: str", ""])


if __name__ == "__main__":
    Path(__file__).with_name("__init__.pyi").write_text(stub_text(), "utf-8")
