"""Catalog of the public names, with one entry per name.

To add a public part, integrator or function, write a module and add an entry here. The catalog is
read by `beamdae.__init__` (lazy imports), `python beamdae/catalog.py` (the type stub
`__init__.pyi`), the command line (names of integrators) and the pages of the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Public:
    """Public name `bd.<name>` or `bd.<package>.<name>`, and the module of its definition.

    Attributes
    ----------
    name
        The public name.
    module
        Dotted path of the module or package from which the name is imported.
    package
        "results" for classes that functions return and base classes, "quantities" for what
        `optimize` and `gradient` evaluate; otherwise empty.
    command
        Name of an integrator on the command line, as in `--integrator ida`; otherwise empty.
    """

    name: str
    module: str
    package: str = ""
    command: str = ""

    @property
    def path(self) -> str:
        """Path of the name in `beamdae`."""
        return f"{self.package}.{self.name}" if self.package else self.name


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
        "Checks of a mechanism before a run, and errors of results.",
    ),
    "errors": ("Errors and warnings", "Exceptions and warnings of beamdae."),
}

GROUPS = (
    Group(
        "mechanism",
        "",
        (
            Public("Mechanism", "beamdae.parts.mechanism"),
            Public("Attachment", "beamdae.parts.attachments", "results"),
            Public("Part", "beamdae.parts.part"),
            Public("model", "beamdae.model_functions"),
            Public("Model", "beamdae.model_functions", "results"),
            Public("param", "beamdae.model_parameters"),
            Public("load_model", "beamdae.cli.model_files.model_file"),
            Public("ConstrainedSystem", "beamdae.equations.assembly.constrained_system"),
            Public("equations_of_motion", "beamdae.equations.assembly.assemble"),
            Public("EquationsOfMotion", "beamdae.equations.equations_of_motion", "results"),
        ),
    ),
    Group(
        "parts",
        "Bodies",
        (
            Public("RigidBody", "beamdae.parts.bodies.rigid_body"),
            Public("PointMass", "beamdae.parts.bodies.point_mass"),
            Public("ReducedBody", "beamdae.parts.bodies.reduced_body"),
        ),
    ),
    Group(
        "parts",
        "Joints",
        (
            Public("Joint", "beamdae.parts.joints.joint"),
            Public("Revolute", "beamdae.parts.joints.joint"),
            Public("Weld", "beamdae.parts.joints.joint"),
            Public("Prismatic", "beamdae.parts.joints.guides"),
            Public("PointOnLine", "beamdae.parts.joints.guides"),
            Public("Distance", "beamdae.parts.joints.distance"),
            Public("SlidingOnBeam", "beamdae.beams.sliding"),
            Public("Gear", "beamdae.parts.joints.gears"),
            Public("RackAndPinion", "beamdae.parts.joints.gears"),
            Public("RollingOnLine", "beamdae.parts.joints.rolling"),
            Public("RollingOnCircle", "beamdae.parts.joints.rolling"),
            Public("Skate", "beamdae.parts.joints.rolling"),
        ),
    ),
    Group(
        "parts",
        "Drivers",
        (
            Public("Driver", "beamdae.parts.joints.drivers"),
            Public("TranslationalDriver", "beamdae.parts.joints.drivers"),
        ),
    ),
    Group(
        "parts",
        "Loads and forces",
        (
            Public("Force", "beamdae.parts.forces.loads"),
            Public("Moment", "beamdae.parts.forces.loads"),
            Public("DistributedForce", "beamdae.beams.beam_loads"),
            Public("MovingForce", "beamdae.beams.beam_loads"),
            Public("Spring", "beamdae.parts.forces.springs"),
            Public("Damper", "beamdae.parts.forces.springs"),
            Public("SpringDamper", "beamdae.parts.forces.springs"),
            Public("TorsionSpring", "beamdae.parts.forces.springs"),
            Public("TorsionDamper", "beamdae.parts.forces.springs"),
            Public("Bushing", "beamdae.parts.forces.bushing"),
            Public("Contact", "beamdae.parts.forces.contact"),
            Public("BeamContact", "beamdae.beams.beam_contact"),
            Public("LineSurface", "beamdae.parts.forces.surfaces"),
            Public("CircleSurface", "beamdae.parts.forces.surfaces"),
            Public("Friction", "beamdae.parts.forces.friction"),
            Public("RayleighDamping", "beamdae.beams.damping"),
            Public("AirDrag", "beamdae.beams.damping"),
            Public("StandardLinearSolid", "beamdae.beams.viscoelasticity"),
            Public("ForceLaw", "beamdae.parts.forces.force_law"),
            Public("positive_part", "beamdae.parts.forces.smooth"),
            Public("smooth_sign", "beamdae.parts.forces.smooth"),
        ),
    ),
    Group(
        "parts",
        "Time laws",
        (
            Public("Law", "beamdae.parts.laws"),
            Public("run_up", "beamdae.parts.laws"),
            Public("sine", "beamdae.parts.laws"),
            Public("piecewise", "beamdae.parts.laws"),
            Public("table", "beamdae.parts.tables"),
            Public("table_from_csv", "beamdae.parts.tables"),
        ),
    ),
    Group(
        "parts",
        "Observables",
        (
            Public("acceleration", "beamdae.parts.observables"),
            Public("relative_displacement", "beamdae.parts.observables"),
            Public("relative_motion", "beamdae.parts.observables"),
        ),
    ),
    Group(
        "parts",
        "Inputs, states and controllers",
        (
            Public("Input", "beamdae.parts.signals", "results"),
            Public("Sensor", "beamdae.parts.signals", "results"),
            Public("State", "beamdae.parts.signals", "results"),
            Public("low_pass", "beamdae.parts.control.blocks"),
            Public("transfer_function", "beamdae.parts.control.blocks"),
            Public("pid", "beamdae.parts.control.blocks"),
            Public("Controller", "beamdae.parts.control.controller"),
            Public("Sample", "beamdae.parts.control.controller", "results"),
        ),
    ),
    Group(
        "parts",
        "Events",
        (
            Public("Event", "beamdae.parts.events", "results"),
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
            Public("Beam", "beamdae.beams.beam"),
            Public("welded_beams", "beamdae.beams.structures"),
            Public("frame", "beamdae.beams.structures"),
            Public("Frame", "beamdae.beams.structures", "results"),
            Public("Line", "beamdae.curves.plane_curves"),
            Public("Arc", "beamdae.curves.plane_curves"),
            Public("Parabola", "beamdae.curves.spline_curves"),
            Public("Curve", "beamdae.curves.spline_curves"),
            Public("IntrinsicCurve", "beamdae.curves.intrinsic_curve"),
            Public("Segment", "beamdae.curves.plane_curves"),
        ),
    ),
    Group(
        "sections",
        "",
        (
            Public("Section", "beamdae.beams.sections"),
            Public("taper", "beamdae.beams.sections"),
            Public("Material", "beamdae.beams.materials"),
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
            Public("Integrator", "beamdae.integrators", "results"),
        ),
    ),
    Group(
        "results",
        "Runs",
        (
            Public("Solution", "beamdae.results.solution", "results"),
            Public("SavedRun", "beamdae.results.storage.saved_run", "results"),
            Public("load", "beamdae.simulation"),
            Public("StepResponse", "beamdae.results.step_response", "results"),
            Public("SectionForces", "beamdae.results.section_forces.section_forces", "results"),
        ),
    ),
    Group(
        "results",
        "Pictures",
        (
            Public("LiveView", "beamdae.live.server", "results"),
            Public("plot", "beamdae.report.pictures.time_plots"),
            Public("Plot", "beamdae.results.displays", "results"),
            Public("Animation", "beamdae.results.displays", "results"),
        ),
    ),
    Group(
        "analysis",
        "Equilibria",
        (
            Public("equilibrium", "beamdae.analysis.statics.static_equilibrium"),
            Public("Equilibrium", "beamdae.results.equilibrium", "results"),
            Public("CriticalPoint", "beamdae.results.equilibrium", "results"),
            Public("buckling", "beamdae.analysis.statics.linear_buckling"),
            Public("Buckling", "beamdae.analysis.statics.linear_buckling", "results"),
            Public("imperfect", "beamdae.analysis.statics.imperfections"),
            Public("knock_down", "beamdae.analysis.statics.imperfections"),
            Public("KnockDown", "beamdae.analysis.statics.imperfections", "results"),
            Public("boundary", "beamdae.analysis.statics.boundary"),
            Public("Boundary", "beamdae.analysis.statics.boundary", "results"),
            Public("BoundaryPoint", "beamdae.analysis.statics.boundary", "results"),
        ),
    ),
    Group(
        "analysis",
        "Modes and linear models",
        (
            Public("modes", "beamdae.analysis.linear_dynamics.natural_modes"),
            Public("Modes", "beamdae.analysis.linear_dynamics.natural_modes", "results"),
            Public("linearize", "beamdae.analysis.linear_dynamics.linear_model"),
            Public("LinearModel", "beamdae.analysis.linear_dynamics.linear_model", "results"),
            Public("bode", "beamdae.analysis.linear_dynamics.bode_diagram"),
            Public("Bode", "beamdae.analysis.linear_dynamics.bode_diagram", "results"),
            Public("margins", "beamdae.analysis.linear_dynamics.stability_margins"),
            Public(
                "StabilityMargins", "beamdae.analysis.linear_dynamics.stability_margins", "results"
            ),
            Public("Crossover", "beamdae.analysis.linear_dynamics.stability_margins", "results"),
        ),
    ),
    Group(
        "analysis",
        "Steady rotation",
        (
            Public("rotation", "beamdae.parts.rotation"),
            Public("campbell", "beamdae.analysis.linear_dynamics.campbell_diagram"),
            Public("Campbell", "beamdae.analysis.linear_dynamics.campbell_diagram", "results"),
        ),
    ),
    Group(
        "analysis",
        "Periodic motions",
        (
            Public("periodic", "beamdae.analysis.periodic.periodic_solution"),
            Public("PeriodicMotion", "beamdae.results.periodic_motion", "results"),
            Public("frequency_response", "beamdae.analysis.periodic.periodic_continuation"),
            Public("FrequencyResponse", "beamdae.results.frequency_response", "results"),
            Public("ResponsePoint", "beamdae.results.frequency_response", "results"),
        ),
    ),
    Group(
        "analysis",
        "Sensitivities and fits",
        (
            Public("sensitivities", "beamdae.analysis.sensitivities.sensitivities"),
            Public("Sensitivities", "beamdae.analysis.sensitivities.sensitivities", "results"),
            Public("equilibrium_sensitivities", "beamdae.analysis.sensitivities.statics"),
            Public("EquilibriumSensitivities", "beamdae.analysis.sensitivities.statics", "results"),
            Public("mode_sensitivities", "beamdae.analysis.sensitivities.modes"),
            Public("ModeSensitivities", "beamdae.analysis.sensitivities.modes", "results"),
            Public("periodic_sensitivities", "beamdae.analysis.sensitivities.periodic"),
            Public("PeriodicSensitivities", "beamdae.analysis.sensitivities.periodic", "results"),
            Public("fit", "beamdae.analysis.fit.fit"),
            Public("Fit", "beamdae.analysis.fit.result", "results"),
            Public("ProfileLikelihood", "beamdae.analysis.fit.profile", "results"),
        ),
    ),
    Group(
        "analysis",
        "Gradients",
        (
            Public("gradient", "beamdae.analysis.gradients.gradients"),
            Public("Gradient", "beamdae.analysis.gradients.gradients", "results"),
            Public("Objective", "beamdae.analysis.gradients.objectives", "results"),
            Public("EndValue", "beamdae.analysis.gradients.objectives", "quantities"),
            Public("TimeIntegral", "beamdae.analysis.gradients.objectives", "quantities"),
            Public("SmoothMaximum", "beamdae.analysis.gradients.objectives", "quantities"),
            Public("SquaredErrors", "beamdae.analysis.gradients.objectives", "quantities"),
        ),
    ),
    Group(
        "analysis",
        "Export",
        (
            Public("export_fmu", "beamdae.export.fmu"),
            Public("ExportedFmu", "beamdae.export.fmu", "results"),
        ),
    ),
    Group(
        "analysis",
        "Optimization",
        (
            Public("optimize", "beamdae.analysis.optimization.optimize"),
            Public("Optimization", "beamdae.analysis.optimization.result", "results"),
            Public("at_most", "beamdae.analysis.optimization.quantities", "quantities"),
            Public("at_least", "beamdae.analysis.optimization.quantities", "quantities"),
            Public("Quantity", "beamdae.analysis.optimization.quantities", "results"),
            Public("Mass", "beamdae.analysis.optimization.quantities", "quantities"),
            Public("Frequency", "beamdae.analysis.optimization.quantities", "quantities"),
            Public("EquilibriumValue", "beamdae.analysis.optimization.quantities", "quantities"),
            Public("EquilibriumErrors", "beamdae.analysis.optimization.quantities", "quantities"),
            Public("CriticalLoad", "beamdae.analysis.optimization.quantities", "quantities"),
            Public("ParameterFunction", "beamdae.analysis.optimization.quantities", "quantities"),
            Public("LargestOf", "beamdae.analysis.optimization.quantities", "quantities"),
        ),
    ),
    Group(
        "studies",
        "",
        (
            Public("sweep", "beamdae.studies"),
            Public("Sweep", "beamdae.studies", "results"),
            Public("SweepResults", "beamdae.studies", "results"),
            Public("study", "beamdae.studies"),
            Public("Study", "beamdae.studies", "results"),
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
            Public("Check", "beamdae.checks", "results"),
            Public("Errors", "beamdae.accuracy.errors", "results"),
            Public("verify", "beamdae.accuracy.runs"),
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

PACKAGES = ("quantities", "results")
NAMES = {public.name: public for group in GROUPS for public in group.names}
INTEGRATORS = {public.command: public for public in NAMES.values() if public.command}


def attributes_by_module(package: str = "") -> dict[str, list[str]]:
    """Return the public names of a package by module; keys are paths without `beamdae.`."""
    names: dict[str, list[str]] = {}
    for public in NAMES.values():
        if public.package == package:
            names.setdefault(public.module.removeprefix("beamdae."), []).append(public.name)
    return names


def stub_text(package: str = "") -> str:
    """Return the text of the type stub `__init__.pyi` of a package."""
    dots = ".." if package else "."
    lines = [
        f"from {dots}{module} import {name} as {name}"
        for module, names in attributes_by_module(package).items()
        for name in names
    ]
    if not package:
        lines += [f"from . import {name} as {name}" for name in PACKAGES]
    return "\n".join([*sorted(lines), *([] if package else ["", "__version__: str"]), ""])


if __name__ == "__main__":
    for package in ("", *PACKAGES):
        stub = Path(__file__).parent / package / "__init__.pyi"
        stub.write_text(stub_text(package), "utf-8")
