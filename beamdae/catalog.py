"""Catalog of the public names, with one entry per name.

To add a public part, integrator or function, write a module and add an entry here. The catalog is
read by `beamdae.__init__` (lazy imports), `python beamdae/catalog.py` (the type stub
`__init__.pyi`), the command line (names of integrators) and the pages of the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any


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


def _create_group(page: str, heading: str, lines: str) -> Group:
    """Return the group of the names in `lines`: path, module and, of integrators, the command."""
    names = []
    for path, module, *command in map(str.split, lines.strip().splitlines()):
        package, _, name = path.rpartition(".")
        names.append(Public(name, f"beamdae.{module}", package, *command))
    return Group(page, heading, tuple(names))


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
    _create_group(
        "mechanism",
        "",
        """
        Mechanism parts.mechanism
        results.Attachment parts.attachments
        Part parts.part
        model model_functions
        results.Model model_functions
        param model_parameters
        load_model cli.model_file
        ConstrainedSystem equations.assembly.constrained_system
        equations_of_motion equations.assembly.assemble
        results.EquationsOfMotion equations.equations_of_motion
        """,
    ),
    _create_group(
        "parts",
        "Bodies",
        """
        RigidBody parts.bodies.rigid_body
        PointMass parts.bodies.point_mass
        ReducedBody parts.bodies.reduced_body
        """,
    ),
    _create_group(
        "parts",
        "Joints",
        """
        Joint parts.joints.joint
        Revolute parts.joints.joint
        Weld parts.joints.joint
        Prismatic parts.joints.guides
        PointOnLine parts.joints.guides
        Distance parts.joints.drivers
        SlidingOnBeam beams.sliding
        Gear parts.joints.rolling
        RackAndPinion parts.joints.rolling
        RollingOnLine parts.joints.rolling
        RollingOnCircle parts.joints.rolling
        Skate parts.joints.rolling
        """,
    ),
    _create_group(
        "parts",
        "Drivers",
        """
        Driver parts.joints.drivers
        TranslationalDriver parts.joints.drivers
        """,
    ),
    _create_group(
        "parts",
        "Loads and forces",
        """
        Force parts.forces.loads
        Moment parts.forces.loads
        DistributedForce beams.beam_loads
        MovingForce beams.beam_loads
        Spring parts.forces.springs
        TorsionSpring parts.forces.springs
        Bushing parts.forces.springs
        Contact parts.forces.contact
        BeamContact beams.beam_contact
        LineSurface parts.forces.contact
        CircleSurface parts.forces.contact
        Friction parts.forces.friction
        RayleighDamping beams.damping
        AirDrag beams.damping
        StandardLinearSolid beams.viscoelasticity
        ForceLaw parts.forces.force_law
        """,
    ),
    _create_group(
        "parts",
        "Time laws",
        """
        results.Law parts.laws
        run_up parts.laws
        sine parts.laws
        half_sine parts.laws
        piecewise parts.laws
        table parts.tables
        table_from_csv parts.table_files
        """,
    ),
    _create_group(
        "parts",
        "Observables",
        """
        acceleration parts.observables
        relative_displacement parts.observables
        relative_motion parts.observables
        """,
    ),
    _create_group(
        "parts",
        "Inputs, states and controllers",
        """
        results.Input parts.signals
        results.Sensor parts.signals
        results.State parts.signals
        transfer_function parts.control.blocks
        pid parts.control.blocks
        Controller parts.control.controller
        results.Sample parts.control.controller
        """,
    ),
    _create_group(
        "parts",
        "Events",
        """
        Event parts.events
        activate parts.event_actions
        deactivate parts.event_actions
        change_law parts.event_actions
        impact parts.event_actions
        """,
    ),
    _create_group(
        "beams",
        "",
        """
        Beam beams.beam
        welded_beams beams.structures
        frame beams.structures
        results.Frame beams.structures
        Line curves.plane_curves
        Arc curves.plane_curves
        Parabola curves.spline_curves
        Curve curves.spline_curves
        IntrinsicCurve curves.intrinsic_curve
        Segment curves.plane_curves
        """,
    ),
    _create_group(
        "sections",
        "",
        """
        Section beams.sections
        taper beams.sections
        Material beams.sections
        """,
    ),
    _create_group(
        "integrators",
        "",
        """
        simulate simulation
        Auto integrators auto
        Ida integrators ida
        Radau integrators radau
        GeneralizedAlpha integrators generalized-alpha
        Integrator integrators
        """,
    ),
    _create_group(
        "results",
        "Runs",
        """
        results.Solution results.solution
        results.SavedRun results.storage.saved_run
        load simulation
        results.StepResponse results.step_response
        results.SectionForces results.section_forces.section_forces
        """,
    ),
    _create_group(
        "results",
        "Pictures",
        """
        results.LiveView live
        plot report.pictures.time_plots
        results.Plot results.displays
        results.Animation results.displays
        """,
    ),
    _create_group(
        "analysis",
        "Equilibria",
        """
        equilibrium analysis.statics.static_equilibrium
        results.Equilibrium results.equilibrium
        results.CriticalPoint results.equilibrium
        buckling analysis.statics.linear_buckling
        results.Buckling analysis.statics.linear_buckling
        imperfect analysis.statics.imperfections
        knock_down analysis.statics.imperfections
        results.KnockDown analysis.statics.imperfections
        boundary analysis.statics.boundary
        results.Boundary analysis.statics.boundary
        results.BoundaryPoint analysis.statics.boundary
        """,
    ),
    _create_group(
        "analysis",
        "Modes and linear models",
        """
        modes analysis.linear_dynamics.natural_modes
        results.Modes analysis.linear_dynamics.natural_modes
        linearize analysis.linear_dynamics.linear_model
        results.LinearModel analysis.linear_dynamics.linear_model
        bode analysis.linear_dynamics.bode_diagram
        results.Bode analysis.linear_dynamics.bode_diagram
        margins analysis.linear_dynamics.stability_margins
        results.StabilityMargins analysis.linear_dynamics.stability_margins
        results.Crossover analysis.linear_dynamics.stability_margins
        """,
    ),
    _create_group(
        "analysis",
        "Steady rotation",
        """
        rotation parts.rotation
        campbell analysis.linear_dynamics.campbell_diagram
        results.Campbell analysis.linear_dynamics.campbell_diagram
        """,
    ),
    _create_group(
        "analysis",
        "Periodic motions",
        """
        periodic analysis.periodic.periodic_solution
        results.PeriodicMotion results.periodic_motion
        frequency_response analysis.periodic.periodic_continuation
        results.FrequencyResponse results.frequency_response
        results.ResponsePoint results.frequency_response
        """,
    ),
    _create_group(
        "analysis",
        "Sensitivities and fits",
        """
        sensitivities analysis.sensitivities.sensitivities
        results.Sensitivities analysis.sensitivities.sensitivities
        equilibrium_sensitivities analysis.sensitivities.statics
        results.EquilibriumSensitivities analysis.sensitivities.statics
        mode_sensitivities analysis.sensitivities.modes
        results.ModeSensitivities analysis.sensitivities.modes
        periodic_sensitivities analysis.sensitivities.periodic
        results.PeriodicSensitivities analysis.sensitivities.periodic
        fit analysis.fit.fit
        results.Fit analysis.fit.result
        results.ProfileLikelihood analysis.fit.profile
        """,
    ),
    _create_group(
        "analysis",
        "Gradients",
        """
        gradient analysis.gradients.gradients
        results.Gradient analysis.gradients.gradients
        results.Objective analysis.gradients.objectives
        quantities.EndValue analysis.gradients.objectives
        quantities.TimeIntegral analysis.gradients.objectives
        quantities.SmoothMaximum analysis.gradients.objectives
        quantities.SquaredErrors analysis.gradients.objectives
        """,
    ),
    _create_group(
        "analysis",
        "Export",
        """
        export_fmu export.fmu
        results.ExportedFmu export.fmu
        """,
    ),
    _create_group(
        "analysis",
        "Optimization",
        """
        optimize analysis.optimization.optimize
        results.Optimization analysis.optimization.result
        quantities.at_most analysis.optimization.quantities
        quantities.at_least analysis.optimization.quantities
        results.Quantity analysis.gradients.objectives
        quantities.Mass analysis.optimization.quantities
        quantities.Frequency analysis.optimization.quantities
        quantities.EquilibriumValue analysis.optimization.quantities
        quantities.EquilibriumErrors analysis.optimization.quantities
        quantities.CriticalLoad analysis.optimization.quantities
        quantities.ParameterFunction analysis.optimization.quantities
        quantities.LargestOf analysis.optimization.quantities
        """,
    ),
    _create_group(
        "studies",
        "",
        """
        sweep studies.sweeps.sweep
        results.Sweep studies.sweeps.sweep
        results.SweepResults studies.sweeps.sweep_results
        study studies.definition
        results.Study studies.definition
        Case studies.case
        grid studies.case
        compare studies.comparison
        """,
    ),
    _create_group(
        "checks",
        "",
        """
        check checks
        results.Check checks
        results.Errors accuracy.errors
        verify accuracy.runs
        """,
    ),
    _create_group(
        "errors",
        "",
        """
        BeamdaeError errors
        BeamdaeWarning errors
        Interrupted interrupts
        """,
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


def load_name(package: str, name: str) -> Any:
    """Return a public object of a package; AttributeError if there is none of this name."""
    public = NAMES.get(name)
    if public is None or public.package != package:
        raise AttributeError(f"module 'beamdae.{package}' has no attribute {name!r}")
    return getattr(import_module(public.module), name)


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
