"""Models that come with beamdae: listed, run and copied by name."""

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
from beamdae.cli.options import require_writable
from beamdae.cli.output import create_console, print_written_files, record_results
from beamdae.errors import BeamdaeError

# Names the starter has for what it imports.
_STARTER_IMPORTS = ("bd", "np")

_STARTER = '''"""A curved strip that swings on a hinge, pushed at its tip."""

import numpy as np

import beamdae as bd


@bd.model(t_end=2.0)
def NAME(length=1.0, push=0.5, elements=4):
    """Strip of `length` [m] on a hinge, under its weight and a `push` [N] at its tip."""
    # Values of these parameters are given as: beamdae run NAME.py --set push=2
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    steel = bd.Material(E=210e9, nu=0.3, rho=7850.0)
    strip = bd.Section.rectangle(steel, width=0.02, height=0.002, damping=1e-4)
    # Bodies are drawn where they begin, in meters and radians.
    curve = bd.Arc(radius=length, length=length, start=(0.0, 0.0), angle=-0.5)
    beam = mech.add(bd.Beam("beam", curve, strip, elements=elements))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (lambda t: push * np.sin(6.0 * t), 0.0)))
    # What is observed becomes columns of the result.
    mech.observe("tip", beam.end)
    mech.observe("middle", beam.section_forces(0.5 * length))
    return mech
'''


def examples_command() -> None:
    """List the models that come with beamdae: `beamdae run example_file:NAME` runs one."""
    from beamdae.report.terminal import text_tables

    about = {name: _first_doc_line(name) for name in example_names()}
    record_results(lambda: {"examples": about})
    screen = create_console()
    screen.print(text_tables.fact_list("", about))
    screen.print("beamdae run example:NAME runs one, beamdae new FILE.py --like NAME copies it.")


def _first_doc_line(name: str) -> str:
    """The first line of an example, which is not run."""
    text = ast.get_docstring(ast.parse((examples_folder() / f"{name}.py").read_bytes())) or ""
    return text.partition("\n")[0]


def new_command(
    path: Annotated[Path, typer.Argument(metavar="MODEL.py", help="File to write.")],
    like: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Example to copy; default a short one.",
            autocompletion=lambda: example_names(),
        ),
    ] = None,
) -> None:
    """Write a model to start from: a short one, or a copy of an example."""
    usable = (
        path.stem.isidentifier() and not iskeyword(path.stem) and path.stem not in _STARTER_IMPORTS
    )
    if path.suffix != ".py" or not usable:
        raise BeamdaeError(
            f"{path}: the file of a model must be called as a function can be, with .py, and not "
            f"{' or '.join(_STARTER_IMPORTS)}."
        )
    if path.exists():
        raise BeamdaeError(f"{path}: it is there already, give another name.")
    require_writable(path.parent, (), "new")
    text = _STARTER.replace("NAME", path.stem)
    if like is not None:
        text = example_file(like.removeprefix(PREFIX)).read_text(encoding="utf-8")
    from beamdae.results.storage.files import write_text

    screen = create_console()
    print_written_files(screen, [write_text(path, text)])
    screen.print(f"beamdae draw {path} shows it, beamdae run {path} runs it.")
