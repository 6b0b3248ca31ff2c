"""Catalog of the public names, one line each.

A new public part, integrator or function is its own file and one line here. It is read by
`beamdae.__init__` (lazy imports), `python -m beamdae.catalog` (the type stub `__init__.pyi`), the
command line (names of integrators) and the pages of the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Public:
    """A public name, `bd.<name>`.

    Attributes
    ----------
    module
        Dotted path of the module that defines it.
    command
        Name of an integrator on the command line, as in `--integrator ida`.
    """

    name: str
    module: str
    command: str = ""


@dataclass(frozen=True)
class Group:
    """Public names that stand together on one page of the reference.

    Attributes
    ----------
    page
        File name of the page without its suffix.
    heading
        Heading above the names; empty for a page without headings.
    """

    page: str
    heading: str
    names: tuple[Public, ...]


# Title and opening sentence of each page of the reference, in reading order.
PAGES = {
    "mechanism": (
        "Mechanism and model",
        "A mechanism of parts, or equations given as expressions, and the function that builds it.",
    ),
    "parts": ("Parts", "Everything that can be added to a mechanism, except beams."),
    "beams": ("Beams and curves", "Beams, the curves of their axes, and frames of several beams."),
    "sections": ("Sections and materials", "Cross-sections and materials of beams."),
    "integrators": ("Integrators", "Simulation of a mechanism, and the methods available for it."),
    "results": ("Results", "Solutions of a run: tables, section forces, files and pictures."),
    "analysis": (
        "Analysis",
        "Equilibria, natural modes, linear models and periodic motions of a mechanism.",
    ),
    "studies": ("Studies and sweeps", "Many runs: compared with references, swept and resumed."),
    "checks": (
        "Checks and verification",
        "Checks of a mechanism before a run, and error estimates after it.",
    ),
    "errors": ("Errors and warnings", "Exceptions and warnings raised by beamdae."),
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
            Public("RigidBody", "beamdae.parts.bodies.rigid_body"),
            Public("PointMass", "beamdae.parts.bodies.point_mass"),
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
            Public("LineSurface", "beamdae.parts.forces.surfaces"),
            Public("CircleSurface", "beamdae.parts.forces.surfaces"),
            Public("Friction", "beamdae.parts.forces.friction"),
            Public("RayleighDamping", "beamdae.beams.damping"),
            Public("AirDrag", "beamdae.beams.damping"),
            Public("ForceLaw", "beamdae.parts.forces.force_law"),
            Public("positive_part", "beamdae.parts.forces.smooth"),
            Public("smooth_sign", "beamdae.parts.forces.smooth"),
        ),
    ),
    Group(
        "parts",
        "Laws of time",
        (
            Public("Law", "beamdae.parts.laws"),
            Public("run_up", "beamdae.parts.laws"),
            Public("sine", "beamdae.parts.laws"),
            Public("piecewise", "beamdae.parts.laws"),
            Public("table", "beamdae.parts.laws"),
        ),
    ),
    Group(
        "parts",
        "What is observed",
        (Public("relative_displacement", "beamdae.parts.observables"),),
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
            Public("Beam", "beamdae.beams.beam"),
            Public("welded_beams", "beamdae.beams.structures"),
            Public("frame", "beamdae.beams.structures"),
            Public("Frame", "beamdae.beams.structures"),
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
            Public("BeamRange", "beamdae.results.diagnostics.strain_validity"),
        ),
    ),
    Group(
        "results",
        "Pictures",
        (
            Public("draw", "beamdae.report.pictures.drawing"),
            Public("plot", "beamdae.report.pictures.time_plots"),
            Public("Plot", "beamdae.results.displays"),
            Public("animate", "beamdae.report.pictures.run_animation"),
            Public("Animation", "beamdae.report.page.motion_player"),
        ),
    ),
    Group(
        "analysis",
        "Equilibria",
        (
            Public("equilibrium", "beamdae.analysis.statics.static_equilibrium"),
            Public("Equilibrium", "beamdae.results.equilibrium"),
            Public("CriticalPoint", "beamdae.results.equilibrium"),
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
            Public("rotation", "beamdae.analysis.linear_dynamics.steady_rotation"),
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
        ),
    ),
    Group(
        "errors",
        "",
        (
            Public("BeamdaeError", "beamdae.errors"),
            Public("BeamdaeWarning", "beamdae.errors"),
        ),
    ),
)

NAMES = {public.name: public for group in GROUPS for public in group.names}
INTEGRATORS = {public.command: public for public in NAMES.values() if public.command}


def attributes_by_module() -> dict[str, list[str]]:
    """Return the public names of each module, which is named relative to `beamdae`."""
    names: dict[str, list[str]] = {}
    for public in NAMES.values():
        names.setdefault(public.module.removeprefix("beamdae."), []).append(public.name)
    return names


def stub_text() -> str:
    """Return the text of `beamdae/__init__.pyi`, from which type checkers learn the names."""
    lines = sorted(
        f"from .{module} import {name} as {name}"
        for module, names in attributes_by_module().items()
        for name in names
    )
    return "\n".join([*lines, "", "__version__: str", ""])


if __name__ == "__main__":
    Path(__file__).with_name("__init__.pyi").write_text(stub_text(), "utf-8")
