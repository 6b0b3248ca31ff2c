"""`beamdae examples` and `beamdae new`: list the installed models, and create a model file."""

from __future__ import annotations

import ast
from keyword import iskeyword
from pathlib import Path
from typing import Annotated

import typer

from beamdae.cli.model_files.example_files import (
    PREFIX,
    example_file,
    example_names,
    examples_folder,
)
from beamdae.cli.output import create_console
from beamdae.cli.output_paths import require_writable
from beamdae.cli.results import Report, ResultFiles
from beamdae.errors import BeamdaeError

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
