"""Commands `new`, `examples`, `draw`, `check` and `view`: files, drawings and checks of models."""

from __future__ import annotations

import ast
import warnings
from dataclasses import asdict, replace
from keyword import iskeyword
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from beamdae.cli import process
from beamdae.cli.job import ModelJob
from beamdae.cli.model_file import (
    PREFIX,
    example_file,
    example_names,
    examples_folder,
)
from beamdae.cli.option_values import parse_assignments, parse_ends
from beamdae.cli.options import EndTime, Out, Repeated, Starts, time_option
from beamdae.cli.output import create_console, record_results, record_warning, require_writable
from beamdae.cli.results import Report, ResultFiles
from beamdae.errors import BeamdaeError

if TYPE_CHECKING:
    pass


# Names that the starter model imports; a model function must not replace them.
_STARTER_IMPORTS = ("bd", "np")

_STARTER = '''"""A curved strip on a hinge, with a force at its tip."""

import numpy as np

import beamdae as bd


@bd.model(t_end=2.0)
def NAME(length=1.0, push=0.5, thickness=0.002):
    """Strip of `length` [m] and `thickness` [m] on a hinge, with a force `push` [N] at its tip."""
    # Set the parameters on the command line: beamdae run NAME.py --set push=2
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    steel = bd.Material(E=210e9, nu=0.3, rho=7850.0)
    strip = bd.Section.rectangle(steel, width=0.02, height=thickness, damping=1e-4)
    # Parts are placed where they are at t = 0, in meters and radians.
    curve = bd.Arc(radius=length, length=length, start=(0.0, 0.0), angle=-0.5)
    beam = mech.add(bd.Beam("beam", curve, strip))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (lambda t: push * np.sin(6.0 * t), 0.0)))
    # Each observed quantity becomes columns of the results.
    mech.observe("tip", beam.end)
    mech.observe("middle", beam.section_forces(0.5 * length))
    return mech
'''


def examples_command() -> None:
    """List the models installed with beamdae; `beamdae run example:NAME` runs one."""
    from beamdae.report.descriptions import Description

    descriptions = {}
    for name in example_names():
        # The file is parsed, not executed.
        tree = ast.parse((examples_folder() / f"{name}.py").read_bytes())
        descriptions[name] = (ast.get_docstring(tree) or "").partition("\n")[0]
    hint = "Run one: beamdae run example:NAME. Copy it: beamdae new FILE.py --like NAME."
    content = Description(descriptions, {"": hint}, lambda: {"examples": descriptions})
    Report("", content).print()


def new_command(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="MODEL.py", help="File to write; its name is the name of the model."
        ),
    ],
    like: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Example to copy. Defaults to a short starter model.",
        ),
    ] = None,
) -> None:
    """Create a model file: a short starter model, or a copy of an example."""
    name = path.stem
    is_usable = name.isidentifier() and not iskeyword(name) and name not in _STARTER_IMPORTS
    if path.suffix != ".py" or not is_usable:
        raise BeamdaeError(
            f"{path}: the file name must be a Python identifier followed by .py, and must not be "
            f"a keyword or {' or '.join(_STARTER_IMPORTS)}; choose another name."
        )
    # Imported here because it imports NumPy.
    from beamdae.model_functions import require_file_name

    # Folders of results have the name of the model.
    require_file_name("new", name)
    if path.exists():
        raise BeamdaeError(f"{path}: the file exists; choose another name.")
    require_writable(("new", (path,)))
    text = _STARTER.replace("NAME", name)
    if like is not None:
        text = example_file(like.removeprefix(PREFIX)).read_text(encoding="utf-8")
    from beamdae.results.storage.files import write_text

    ResultFiles([write_text(path, text)]).print_paths()
    create_console().print(f"Draw it: beamdae draw {path}. Run it: beamdae run {path}.")


def draw_command(
    job: ModelJob,
    out: Out = Path("results"),
) -> None:
    """Draw a model with its joints, supports, loads and part names (PNG).

    Exits with 0 on success, 1 if drawing failed, and 2 for a usage or model error.
    """
    job.needs = process.MODELS
    model = job.model
    picture = out / f"{model.name}_drawing.png"
    require_writable(("--out", (picture,)))
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report.descriptions import Description

    mechanism = model()
    if not isinstance(mechanism, Mechanism):
        raise BeamdaeError(
            f"draw: {model.name} consists of equations without a shape; only a Mechanism can be "
            "drawn."
        )
    types = {name: type(part).__name__ for name, part in mechanism.parts.items()}
    Report(model.name, Description(data=lambda: {"parts": types})).print()
    files = ResultFiles()
    files.write(model.name, lambda: [mechanism.draw().save(picture)])
    files.finish()


def check_command(
    job: ModelJob,
    start: Starts = None,
    predict: Annotated[
        bool, typer.Option(help="Predict steps and wall time from at most 1 s of the run.")
    ] = True,
) -> None:
    """Build a model, compute its consistent start, and report its mobility, errors and defects.

    Exits with 0 if the model can be run, and with 2 and a message for a usage or model error.
    """
    model = job.model
    from beamdae.checks import check, describe_check
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report.descriptions import Description

    mechanism = model()
    result = check(mechanism, model.t_end, predict, job.start(start))
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    for sentence in result.warnings:
        record_warning(sentence)
    facts = describe_check(result)
    name = f"{model.name}: {facts.pop('verdict')}"
    types = {name: type(part).__name__ for name, part in parts.items()}
    values = asdict(replace(result, errors=None))
    del values["name"], values["warnings"], values["errors"]
    data = {"ok": result.ok, "mobility": result.mobility, **values, "parts": types}
    Report(name, Description(facts, data=lambda: data)).print()
    if not result.ok:
        raise BeamdaeError(result.problem)


def view_command(
    job: ModelJob,
    ranges: Annotated[
        Repeated,
        typer.Option(
            "--range",
            metavar="NAME=FIRST:LAST",
            help="Ends of the slider of a parameter, for example radius=50cm:2m; repeatable.",
        ),
    ] = None,
    t_end: EndTime = None,
    time_limit: Annotated[
        float,
        time_option(help="Maximum wall time of a run in seconds."),
    ] = 10.0,
    port: Annotated[int, typer.Option(help="Port of the server; 0 chooses a free port.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", metavar="", help="Open the web browser.")
    ] = True,
) -> None:
    """Show a model with sliders for its parameters; the drawing follows, and runs are animated.

    The page is served on this computer only, at the printed address, until Ctrl-C. Exits with 130
    after Ctrl-C, and with 2 and a message for a usage or model error.
    """
    model = job.model
    from beamdae.live import LiveView, create_session

    texts = parse_assignments(ranges, "--range")
    units = {name: info.unit for name, info in model.parameter_info.items()}
    ends = {name: parse_ends("--range", name, x, units.get(name, "")) for name, x in texts.items()}
    live = LiveView(create_session(model, ends, t_end, time_limit), port, is_embedded=False)
    try:
        if problem := live.session.draw({}).get("error"):
            raise BeamdaeError(problem)
        record_results(lambda: {"address": live.url})
        create_console().print(
            f"{model.name}: {live.url}\nCtrl-C ends the view.", soft_wrap=True, highlight=False
        )
        if browser:
            live.open()
        with warnings.catch_warnings():
            # The page shows the warnings of runs.
            warnings.simplefilter("ignore", UserWarning)
            live.wait()
    finally:
        live.close()
