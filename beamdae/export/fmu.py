"""Export of models as functional mock-up units (FMUs) for co-simulation.

Runs before an export give the settings of Radau (a pilot run) and warnings (a trial run).
"""

from __future__ import annotations

import io
import os
import re
import shlex
import tempfile
import uuid
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from beamdae.beams.damping import EXAMPLE_DAMPING, find_undamped_beams
from beamdae.core.compilers import (
    PLATFORMS,
    Platform,
    compile_library,
    current_platform,
    find_compiler,
)
from beamdae.core.library import FOLDER
from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.watched_terms import (
    SurfaceGapTerm,
    compile_surface_gaps,
    compile_table_arguments,
)
from beamdae.errors import (
    BeamdaeError,
    list_first,
    record_warnings,
    require_choice,
    require_count,
    require_finite,
    require_names,
    require_positive,
    require_sequence,
    short_repr,
    suggest,
    warn_user,
)
from beamdae.export.c_code import UnsupportedOperationError, format_string
from beamdae.export.model_description import (
    Description,
    write_build_description,
    write_description,
)
from beamdae.export.model_source import ExportedModel, Output, Value, write_model_source
from beamdae.export.parameter_maps import map_numbers
from beamdae.integrators.alpha.family import family_parameters
from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.alpha.stepper import AlphaStepper
from beamdae.integrators.compiled_run import require_core
from beamdae.integrators.error_control import motion_scales
from beamdae.integrators.integrator import Integrator
from beamdae.integrators.radau.radau import Radau
from beamdae.integrators.radau.stepper import RadauStepper
from beamdae.integrators.reaction_balance import remove_redundant
from beamdae.integrators.run_plan import RunPlan, plan_run
from beamdae.interrupts import interruptible
from beamdae.model_functions import Model
from beamdae.parts.laws import Law
from beamdae.parts.mechanism import Mechanism
from beamdae.parts.signals import Input
from beamdae.results.columns import remove_unit, select_columns
from beamdae.results.storage.files import require_file_path, write_bytes
from beamdae.simulation import as_equations, compute_output_times, unpack_model

PART = "export_fmu"
C_FOLDER = Path(__file__).parent / "c"
_SHARED_SOURCES = ("instance.c", "points.c", "variables.c")
_SHARED_HEADERS = (
    "instance.h",
    "tables.h",
    "points.h",
    "variables.h",
    "model.h",
)
# Parts of the core besides the loop of the method.
_CORE_SOURCES = ("linear.c", "sums.c", "steps.c")
_CORE_HEADERS = ("core.h", "arrays.h", "elimination.h")
_INTERFACE_HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
# Of binaries, besides those of the core.
_FLAGS = ("-O2", "-fvisibility=hidden", "-s")
_DEFAULT_STEP = 1e-3  # s, of the communication with adaptive steps
# Settings of GeneralizedAlpha whose defaults alone the C code knows.
_FIXED_SETTINGS = ("rtol", "formulation", "start")
# Entries of the archive have the same date, so that equal models give equal files.
_DATE = (1980, 1, 1, 0, 0, 0)
_FILE_MODE = 0o100755  # regular, executable file
_LICENSE = """\
The sources of this FMU were written by beamdae and are licensed under the MIT license.
The headers fmi2*.h and fmi3*.h are licensed under the 2-Clause BSD license by the Modelica
Association Project "FMI"; the files contain the text of the license.
"""


@dataclass(frozen=True)
class ExportedFmu:
    """Result of `export_fmu`.

    Attributes
    ----------
    path
        The file.
    fmi
        Version of the interface, 2 or 3.
    integrator
        Label of the integrator, such as "Radau(rtol=0.0001)".
    communication_step
        Default communication step [s].
    inputs, parameters, outputs
        Names of the variables.
    platforms
        Names of the platforms of the binaries.
    size
        Size of the file [bytes].
    warnings
        Warnings that the call issued.
    """

    path: Path
    fmi: int
    integrator: str
    communication_step: float
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    platforms: tuple[str, ...]
    size: int
    warnings: tuple[str, ...] = field(default=(), repr=False)


@interruptible
@record_warnings
def export_fmu(
    model: Any,
    path: str | Path,
    integrator: Radau | GeneralizedAlpha | None = None,
    *,
    communication_step: float | None = None,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    parameters: Sequence[str] = (),
    fmi: int = 2,
    start: Any = None,
    t_end: float | None = None,
    platforms: Sequence[str] | None = None,
    real_time: int | None = None,
) -> ExportedFmu:
    """Export a model as an FMU for co-simulation, which needs neither Python nor beamdae.

    The FMU takes the steps of the integrator with the same kernels and equations: the adaptive
    steps of `Radau`, or the fixed steps of `GeneralizedAlpha`, whose results differ from those of
    `simulate` by rounding errors and errors of Newton's iteration. Unless it takes more than 20 000
    steps, a trial run with the start values of inputs and parameters checks these steps; its
    warnings, such as those of fixed steps that are too long, are those of the export.

    Communication steps can have any length. Generalized-alpha divides them into equal internal
    steps of at most its `step`. Each change of the internal step, and each breakpoint of a law,
    restarts the method with consistent accelerations; constant communication steps that are
    multiples of `step` avoid this. A communication step shorter than 1 % of `step` extrapolates the
    motion and is part of the next. With generalized-alpha, contacts that begin and end within one
    internal step are not noticed; a step of Radau that passes over a contact is repeated with half
    its length.

    Radau keeps its step size between communication steps. While inputs do not change, its steps
    pass over communication points, and outputs are those of the polynomial of the step. If an input
    changes, the step is repeated up to the communication point; while inputs change at every
    communication point, steps end there. Tolerances are relative to the amplitudes of the motion
    that a pilot run measures with the start values of the inputs.

    Inputs are constant during a communication step. Where inputs or parameters change,
    accelerations and reactions change with them, as at the samples of a `Controller`; outputs that
    are read before the next step show this.

    Directional derivatives are those of the outputs at the end of the last internal step (with
    Radau, of the last communication step) with respect to inputs and parameters held during this
    step, for the same positions and velocities at its beginning. The state of an instance can be
    saved, restored and serialized; runs from a restored state are equal to the last bit.

    Parameters
    ----------
    model
        A model function, a mechanism, a constrained system or equations of motion.
    path
        Path of the file to write, with the suffix ".fmu".
    integrator
        `Radau`, or `GeneralizedAlpha` with fixed steps, `formulation="index3"` and
        `start="cured"`, with which contacts are reported by a `BeamdaeWarning`. Limits of the
        number of steps and of the wall time do not apply. Defaults to `Radau()`.
    communication_step
        Default communication step [s]. Defaults to the step of generalized-alpha, or to 1 ms.
    inputs
        Names of inputs of the mechanism, which must not prescribe motions. Defaults to all inputs
        whose value is a number.
    outputs
        Names of observed columns or observables, such as "tip.x" or "tip". Defaults to all.
    parameters
        Names of parameters of the model function to be tunable. A parameter is accepted if it
        changes nothing but numbers of the equations, each through a sum of products of powers of
        the parameters, and neither positions nor velocities at the start. Both are verified by
        building the model with other values, up to a million times smaller and larger ones. If the
        model rejects some of them, the range of the parameter ends by up to 3 % before the limit of
        the model, or at a limit that is a round number; the FMU rejects values outside.
    fmi
        Version of the interface, 2 (accepted by most tools) or 3.
    start
        Start of the run, as in `simulate`.
    t_end
        Default end time [s] of the FMU. Defaults to the end time of the model.
    platforms
        Platforms of the binaries: "x86_64-linux", "aarch64-linux", "x86_64-windows",
        "x86_64-darwin" and "aarch64-darwin". Defaults to this machine. Other platforms require the
        package ziglang (`pip install "beamdae[fmu]"`). Empty for sources only.
    real_time
        Number of Newton iterations of every step, each step with one factorization, so that all
        steps take the same time. From 2 on, diverging iterations are errors. By default, the number
        follows from the tolerance. Requires generalized-alpha.

    Returns
    -------
    ExportedFmu
        Path, variables and platforms.

    Raises
    ------
    BeamdaeError
        If the model has events, parts that events switch, sampled controllers, redundant
        constraints, tables that end the run or formulas that have no C expression, an input
        prescribes a motion, an argument is invalid, or no C compiler is found.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    >>> mech.observe("ball", ball.point)
    >>> fmu = bd.export_fmu(mech, "ball.fmu", t_end=1.0, outputs=["ball.y"], platforms=())
    >>> fmu.outputs
    ('ball.y',)
    """
    file = require_file_path(PART, path)
    if file.suffix != ".fmu":
        raise BeamdaeError(f"{PART}: the path must end with .fmu, got {short_repr(path)}.")
    require_choice(PART, "fmi", fmi, (2, 3))
    method = Radau() if integrator is None else _require_method(integrator)
    is_adaptive = isinstance(method, Radau)
    if is_adaptive and real_time is not None:
        raise BeamdaeError(
            f"{PART}: real_time requires fixed steps, but integrator= is {method.label}; set it to "
            "GeneralizedAlpha(step), or omit real_time=."
        )
    if communication_step is None:
        communication_step = method.step if isinstance(method, GeneralizedAlpha) else _DEFAULT_STEP
    step = require_positive(PART, "communication_step", communication_step)
    require_core(f"{PART}: the FMU", "")
    targets = _require_platforms(platforms, fmi)
    iterations = 0 if real_time is None else require_count(PART, "real_time", real_time)
    built, end, origin = unpack_model(PART, model, t_end)
    stop = require_positive(PART, "t_end", end)
    names = _require_parameters(model, parameters)
    equations = as_equations(PART, built, start)
    _require_exportable(equations)
    selected_inputs = _select_inputs(equations, inputs)
    selected_outputs = _select_outputs(equations, outputs)
    _warn_of_inaccurate_steps(equations, method, selected_inputs)
    headers = {x.observable.headers[x.column] for x in selected_outputs}
    warn_of_trial_run(PART, equations, stop, method, headers)

    steps = _plan_steps(equations, method, step, stop)
    exported = ExportedModel(
        equations=equations,
        outputs=selected_outputs,
        numbers=map_numbers(
            PART,
            _build_neighbors(model, origin, start, method, stop, equations),
            equations,
            steps["state"],
            selected_inputs,
            {name: float(origin["parameters"][name]) for name in names},
        ),
        fixed_iterations=iterations,
        **steps,
    )
    kind = "radau" if is_adaptive else "alpha"
    loops = "model.c", f"{kind}_steps.c", *_SHARED_SOURCES, f"{kind}.c", *_CORE_SOURCES
    description = Description(
        name=origin.get("name", file.stem),
        identifier=re.sub(r"\W|^(?=\d)", "_", file.stem, flags=re.ASCII),
        token="",
        step=step,
        stop=stop,
        values=exported.numbers.values,
        outputs=exported.outputs,
        sources=(*loops, f"fmi{fmi}.c"),
        internal_step=None if isinstance(method, Radau) else method.step,
    )
    _require_unique_names(description)
    contents, binaries = _compile(exported, description, fmi, targets)
    write_bytes(file, _pack(contents | binaries))
    values = exported.numbers.values
    return ExportedFmu(
        path=file,
        fmi=fmi,
        integrator=method.label,
        communication_step=step,
        inputs=tuple(x.name for x in values if x.is_input),
        parameters=tuple(x.name for x in values if not x.is_input),
        outputs=tuple(x.name for x in exported.outputs),
        platforms=tuple(x.name for x in targets),
        size=file.stat().st_size,
    )


def _require_method(integrator: Any) -> Radau | GeneralizedAlpha:
    """Return the integrator if the C code takes its steps."""
    if isinstance(integrator, Radau):
        return integrator
    fixed = GeneralizedAlpha()
    given = integrator.label if isinstance(integrator, Integrator) else short_repr(integrator)
    if isinstance(integrator, GeneralizedAlpha):
        values = {x: getattr(integrator, x) for x in _FIXED_SETTINGS}
        wrong = [f"{x}={y!r}" for x, y in values.items() if y != getattr(fixed, x)]
        if not wrong:
            return integrator
        given = f"GeneralizedAlpha({', '.join(wrong)})"
    raise BeamdaeError(
        f"{PART}: integrator must be Radau, or GeneralizedAlpha with fixed steps, "
        f'formulation="{fixed.formulation}" and start="{fixed.start}", got {given}.'
    )


def _plan_steps(
    equations: EquationsOfMotion,
    method: Radau | GeneralizedAlpha,
    communication_step: float,
    stop: float,
) -> dict[str, Any]:
    """Return the fields method, state, step, shift and start_rate of `ExportedModel`."""
    times = np.array([0.0, stop])
    plan = plan_run(equations, times)
    if isinstance(method, Radau):
        workspace, start_rate = plan_radau(equations, times, method)
        return {
            "method": workspace,
            "state": plan.state,
            "step": communication_step,
            "start_rate": start_rate,
        }
    return {
        "method": cast("AlphaStepper", method.method_on(plan)).workspace,
        "state": plan.state,
        "step": method.step,
        "shift": family_parameters(method.family, method.rho_inf).shift,
    }


def _build_neighbors(
    model: Any,
    origin: Mapping[str, Any],
    start: Any,
    method: Radau | GeneralizedAlpha,
    stop: float,
    equations: EquationsOfMotion,
) -> Callable[[dict[str, float]], tuple[EquationsOfMotion, State]]:
    """Return a function of values of parameters that builds the equations and the start."""
    gaps = compile_surface_gaps(equations) if isinstance(method, Radau) else ()

    def build(values: dict[str, float]) -> tuple[EquationsOfMotion, State]:
        others = as_equations(PART, model(**{**origin["parameters"], **values}), start)
        # The FMU searches the steps for contacts with the surfaces of the default parameters.
        for gap, other in zip(gaps, compile_surface_gaps(others), strict=False):
            if not np.array_equal(gap.distance.numbers, other.distance.numbers):
                raise BeamdaeError(
                    f"the surface of {gap.part} changes, where adaptive steps search for contacts"
                )
        return others, plan_run(others, np.array([0.0, stop])).state

    return build


def _warn_of_inaccurate_steps(
    equations: EquationsOfMotion, method: Radau | GeneralizedAlpha, inputs: Sequence[Any]
) -> None:
    """Warn about contacts within fixed steps, and vibrations that shorten adaptive ones."""
    if isinstance(method, GeneralizedAlpha):
        warn_of_fixed_steps(PART, compile_surface_gaps(equations), method.step)
    elif inputs:
        _warn_of_undamped_beams(equations)


def _warn_of_undamped_beams(equations: EquationsOfMotion) -> None:
    """Warn about beams without damping, whose vibrations shorten adaptive steps."""
    # An arm of 64 steel elements takes 4.4 s per millisecond if its torque jumps every millisecond.
    # With EXAMPLE_DAMPING, it takes 50 ms.
    if beams := find_undamped_beams(equations.mechanism):
        warn_user(
            f"{PART}: jumps of inputs excite the fastest vibrations of beams without damping "
            f"({list_first(beams)}), which adaptive steps resolve: they become very "
            f"short; set damping= of the sections, such as {EXAMPLE_DAMPING:g} s."
        )


def _pack(contents: Mapping[str, bytes]) -> bytes:
    """Return a ZIP archive."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name, _DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = _FILE_MODE << 16
            archive.writestr(info, content)
    return stream.getvalue()


def _require_exportable(e: EquationsOfMotion) -> None:
    """Reject models that need more than steps of the same equations."""
    if e.configurations is not None or e.events:
        events = ", ".join(event.name for event in e.events) or "inactive parts"
        raise BeamdaeError(
            f"{PART}: the model has events ({events}), which the FMU cannot detect; "
            "remove the events and parts that are inactive at the start."
        )
    for term in compile_table_arguments(e):
        if term.is_limited:
            raise BeamdaeError(
                f"{PART}: the table of {term.part} ends the run where its argument leaves it, "
                'which the FMU cannot detect; use outside="hold".'
            )
    for owner, law in _time_laws(e.mechanism):
        if law.ranges:
            raise BeamdaeError(
                f"{PART}: the table of {owner} ends the run where the time leaves it, "
                'which the FMU cannot detect; use outside="hold".'
            )
    if remove_redundant(e, 0.0) is not None:
        raise BeamdaeError(
            f"{PART}: the model has redundant constraints, whose reactions the FMU cannot "
            "distribute; remove them."
        )


def _time_laws(mechanism: Mechanism | None) -> Iterator[tuple[str, Law]]:
    """Yield the time laws of parts, gravity and inputs, with the names of their owners."""
    if mechanism is None:
        return
    for part in mechanism.parts.values():
        yield from ((part.name, law) for law in part.laws)
    if mechanism.gravity_laws is not None:
        yield from (("gravity", law) for law in mechanism.gravity_laws.laws)
    yield from mechanism.input_laws.items()


def _require_platforms(platforms: Any, fmi: int) -> tuple[Platform, ...]:
    if platforms is None:
        here = current_platform()
        return () if here is None or (fmi == 2 and not here.fmi2_name) else (here,)
    allowed = f"a list of {', '.join(PLATFORMS)}"
    names = tuple(require_sequence(PART, "platforms", platforms, allowed))
    for name in names:
        require_choice(PART, "platforms", name, tuple(PLATFORMS))
        if fmi == 2 and not PLATFORMS[name].fmi2_name:
            raise BeamdaeError(f"{PART}: FMI 2.0 has no name for the platform {name}; pass fmi=3.")
    return tuple(PLATFORMS[name] for name in dict.fromkeys(names))


def _require_names(name: str, value: Any) -> list[str]:
    names = require_names(PART, name, value, "a list of names")
    return list(dict.fromkeys(names))


def _require_parameters(model: Any, parameters: Any) -> list[str]:
    names = _require_names("parameters", parameters)
    known: Mapping[str, Any] = model.parameters if isinstance(model, Model) else {}
    for name in names:
        if name not in known:
            raise BeamdaeError(
                f"{PART}: the model has no parameter {short_repr(name)}{suggest(name, known)}; "
                f"available parameters: {', '.join(known) or 'none'}."
            )
        if not isinstance(known[name], float):
            raise BeamdaeError(
                f"{PART}: the parameter {name} must be a real number to be tunable, got "
                f"{short_repr(known[name])}."
            )
        require_finite(PART, name, known[name])
    return names


def _select_inputs(e: EquationsOfMotion, inputs: Any) -> list[tuple[Value, np.ndarray]]:
    terms = {term.name: term for term in e.inputs}
    driven = {
        signal.name: part.part.name
        for part in e.statements
        for constraint in part.constraints
        for signal, _ in constraint.signals
        if isinstance(signal, Input)
    }
    if inputs is None:
        names = [name for name, term in terms.items() if term.law is None]
    else:
        names = _require_names("inputs", inputs)
    for name in names:
        if name not in terms:
            raise BeamdaeError(
                f"{PART}: the model has no input {short_repr(name)}{suggest(name, terms)}; "
                f"available inputs: {', '.join(terms) or 'none'}."
            )
        if terms[name].law is not None:
            raise BeamdaeError(
                f"{PART}: the input {name} is a law of time; give it a number to export it."
            )
        if name in driven:
            raise BeamdaeError(
                f"{PART}: the input {name} prescribes the motion of {driven[name]}, which would "
                "jump where the FMU changes the input; drive by a force or moment (bd.pid), or "
                "omit the input from inputs=."
            )
    return [
        (Value(x.name, x.unit, float(x.value), is_input=True), np.array(x.indices, int))
        for x in (terms[name] for name in names)
    ]


def _select_outputs(e: EquationsOfMotion, outputs: Any) -> tuple[Output, ...]:
    columns = {
        header: (observable, k)
        for observable in e.observables
        for k, header in enumerate(observable.headers)
    }
    # Inputs are observed under their names.
    names = {term.name for term in e.inputs}
    headers = [header for header in columns if remove_unit(header) not in names]
    if outputs is not None:
        selected = [
            select_columns(columns, name, PART) for name in _require_names("outputs", outputs)
        ]
        headers = list(dict.fromkeys(header for group in selected for header in group))
    result = []
    for header in headers:
        observable, k = columns[header]
        if observable.has_accelerations:
            raise BeamdaeError(
                f"{PART}: {header} depends on accelerations, which FMUs do not compute; name other "
                "outputs."
            )
        name = remove_unit(header)
        result.append(Output(name, observable.columns[k].unit, observable, k))
    return tuple(result)


def _require_unique_names(description: Description) -> None:
    names = [x.name for x in description.values] + [x.name for x in description.outputs]
    names.append("time")
    for name in names:
        if names.count(name) > 1:
            raise BeamdaeError(
                f"{PART}: several variables have the name {name}; rename one, or select inputs, "
                "outputs and parameters."
            )


def _compile(
    exported: ExportedModel,
    description: Description,
    fmi: int,
    targets: Sequence[Platform],
) -> tuple[dict[str, bytes], dict[str, bytes]]:
    """Return texts and binaries of the archive by name."""
    try:
        model_source = write_model_source(exported)
    except UnsupportedOperationError as problem:
        raise BeamdaeError(
            f"{PART}: a formula of the model has no C expression ({problem}); use other functions."
        ) from None
    # Equal models have equal tokens.
    contents = model_source + write_description(description, fmi)
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, contents)}}}"
    description = replace(description, token=token)
    sources = {"model.c": f"{model_source}\nconst char model_token[] = {format_string(token)};\n"}
    headers = *_SHARED_HEADERS, *_CORE_HEADERS, *_INTERFACE_HEADERS[fmi]
    for name in (*description.sources[1:], *headers):
        file = C_FOLDER / name
        sources[name] = (file if file.exists() else FOLDER / name).read_text("utf-8")
    texts = {"modelDescription.xml": write_description(description, fmi)}
    texts |= {f"sources/{name}": text for name, text in sources.items()}
    texts["documentation/licenses/license.txt"] = _LICENSE
    if fmi == 3:
        texts["sources/buildDescription.xml"] = write_build_description(description)
    binaries: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for source, text in sources.items():
            (folder / source).write_text(text, "utf-8")
        for target in targets:
            compiler = find_compiler(PART, target)
            library = folder / f"{target.name}{target.suffix}"
            flags = [*_FLAGS, *shlex.split(os.environ.get("CFLAGS", ""))]
            files = [folder / x for x in description.sources]
            compile_library(PART, compiler, flags, files, library, target.suffix == ".dll")
            place = target.fmi2_name if fmi == 2 else target.name
            entry = f"binaries/{place}/{description.identifier}{target.suffix}"
            binaries[entry] = library.read_bytes()
    return {name: text.encode() for name, text in texts.items()}, binaries


Array = np.ndarray
_MAX_TRIAL_STEPS = 20_000


def plan_radau(
    equations: EquationsOfMotion, times: Array, integrator: Radau
) -> tuple[Workspace, float]:
    """Return the steps that Radau takes in a run over `times` [s], with its pilot run.

    The lower bound on 2 / h^2 of the first step h [1/s^2] follows the work arrays.
    """
    plans: list[RunPlan] = []

    class Recorder(Radau):
        def method_on(self, plan: RunPlan) -> RadauStepper:
            plans.append(plan)
            return super().method_on(plan)

    # The main run ends after one step.
    settings = vars(integrator) | {"max_steps": 1, "time_limit": None}
    Recorder(**settings).integrate(equations, times)
    stepper = integrator.method_on(plans[-1])
    local = stepper.resolved_options["local_tolerance"]
    return stepper.workspace, motion_scales(plans[-1]).rate ** 2 / local


def warn_of_fixed_steps(call: str, gaps: Sequence[SurfaceGapTerm], step: float) -> None:
    """Warn about contacts in a model that is exported with fixed steps of `step` [s]."""
    names = list(dict.fromkeys(gap.part for gap in gaps))
    if not names:
        return
    contacts = list_first(names)
    warn_user(
        f"{call}: fixed steps of {step:g} s are inaccurate where contacts ({contacts}) last only "
        "a few steps, and pass over shorter ones; choose Radau, or halve the step until the "
        "results stay the same."
    )


def warn_of_trial_run(
    call: str,
    equations: EquationsOfMotion,
    t_end: float,
    method: GeneralizedAlpha | Radau,
    outputs: Collection[str],
) -> None:
    """Issue the warnings of a run to `t_end` [s] with the method of an FMU.

    The run has the default values of inputs and parameters. The errors of the columns `outputs`
    (headers) are measured. Runs of more than `_MAX_TRIAL_STEPS` steps are omitted
    (generalized-alpha) or end there (Radau).
    """
    method = replace(method, time_limit=None)
    if isinstance(method, Radau):
        method = replace(method, max_steps=_MAX_TRIAL_STEPS)
    elif t_end > _MAX_TRIAL_STEPS * method.step:
        return
    run = method.integrate(equations, compute_output_times(call, t_end, None))
    # An FMU has other output rows.
    omitted = {*equations.build_warnings, *run.row_warnings}
    messages = [x for x in run.model_warnings if x not in omitted]
    if run.status.kind == "failed":
        messages.append(run.status.sentence)
    elif run.status.kind == "limited":
        messages.append(
            f"{_MAX_TRIAL_STEPS} adaptive steps end at t = {run.trajectory.end:.3g} s of "
            f"{t_end:g} s; the FMU takes as many: damp fast vibrations, or choose GeneralizedAlpha."
        )
    else:
        messages += run.errors.select(outputs).sentences()
    for sentence in messages:
        warn_user(f"{call}: in a trial run, {sentence}")
    # An FMU does not search its steps for these peaks.
    if peaks := run.integrator.get("restarted_at"):
        warn_user(
            f"{call}: adaptive steps of an FMU may pass over short peaks of forces ({peaks}); "
            "choose GeneralizedAlpha with steps much shorter than the peaks."
        )
