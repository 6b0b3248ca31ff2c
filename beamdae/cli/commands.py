"""The command line: run, compare, check and list model files."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from typer.core import TyperGroup

from beamdae.cli.compare import compare_command
from beamdae.cli.options import (
    EndTime,
    ModelFile,
    ModelName,
    Out,
    OutputStep,
    Settings,
    assignments,
    console,
    require_writable,
    say_warning,
    say_written,
)
from beamdae.errors import BeamdaeError, BeamdaeWarning, one_of

# Whatever imports NumPy or CasADi is imported inside the commands: help has to answer at once.
if TYPE_CHECKING:
    from beamdae.model_functions import Model
    from beamdae.results.solution import Solution


class _Commands(TyperGroup):
    """Commands whose users' mistakes are told in one line."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except BeamdaeError as problem:
            typer.echo(f"error: {' '.join(str(problem).split())}", err=True)
            raise typer.Exit(2) from None


app = typer.Typer(
    cls=_Commands, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)

app.command("compare")(compare_command)


def main() -> None:
    """Run the command line."""
    app(prog_name="beamdae")


def _say_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"beamdae {version('beamdae')}")
        raise typer.Exit


@app.callback()
def beamdae(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Say the version."),
    ] = False,
) -> None:
    """Simulate curved beams in flexible multibody systems."""


@app.command()
def run(
    path: ModelFile,
    settings: Settings = None,
    model_name: ModelName = None,
    integrator: Annotated[
        str, typer.Option(help="auto, ida, radau or generalized-alpha.")
    ] = "auto",
    rtol: Annotated[
        float | None,
        typer.Option(help="Relative tolerance (generalized-alpha: adaptive steps)."),
    ] = None,
    step: Annotated[float | None, typer.Option(help="Step in seconds (generalized-alpha).")] = None,
    rho_inf: Annotated[
        float | None, typer.Option(help="Spectral radius at infinity (generalized-alpha).")
    ] = None,
    formulation: Annotated[
        str | None, typer.Option(help="Form of the equations, such as ggl or index3.")
    ] = None,
    error_control: Annotated[
        str | None, typer.Option(help="What the error test sees (ida): positions, ...")
    ] = None,
    max_order: Annotated[str | None, typer.Option(help="1 to 5, or auto (ida).")] = None,
    t_end: EndTime = None,
    output_step: OutputStep = None,
    out: Out = Path("results"),
    estimate: Annotated[
        bool, typer.Option(help="Estimate the error of every column by a second run.")
    ] = True,
    verify: Annotated[
        bool, typer.Option("--verify", help="Compare with another method at a tighter tolerance.")
    ] = False,
) -> None:
    """Simulate one model and write its CSV, JSON and PNG."""
    model = _model(path, model_name, settings)
    method = _integrator(
        integrator,
        {
            "rtol": rtol,
            "step": step,
            "rho_inf": rho_inf,
            "formulation": formulation,
            "error_control": error_control,
            "max_order": int(max_order) if max_order and max_order.isdecimal() else max_order,
        },
    )
    require_writable(out)
    from beamdae.report import pictures, terminal
    from beamdae.simulation import simulate

    with _progress(t_end or model.t_end) as progress, warnings.catch_warnings():
        # They are told with the result.
        warnings.simplefilter("ignore", BeamdaeWarning)
        reached = partial(progress, method.label) if progress else None
        solution = simulate(model, method, t_end, output_step, reached)
    # Before the second run: whatever ends that leaves this one.
    written = solution.to_csv(out / f"{model.name}.csv")
    screen = console()
    rows = terminal.run_facts(solution.summary(), solution.integrator)
    screen.print(terminal.facts(model.name, rows))
    if len(solution.observed.columns):
        errors, beyond = _errors(solution, estimate, verify)
        screen.print(terminal.ranges(solution.observed, errors))
        if beyond:
            say_warning(screen, beyond)
        if errors is not None:
            known = errors.astype(object).where(errors.notna(), None)
            solution.to_csv(written, errors=known.to_dict("index"))
    if solution.validity:
        screen.print(terminal.validity(solution.validity))
    for sentence in solution.warnings:
        say_warning(screen, sentence)
    picture = pictures.picture_of_run(
        out / f"{model.name}.png", solution.table(), f"{model.name}, {method.label}"
    )
    say_written(screen, [written, written.with_suffix(".json"), picture])
    if not solution.status.success:
        typer.echo(f"failed: {solution.status.sentence}", err=True)
        raise typer.Exit(1)


@app.command()
def check(path: ModelFile, settings: Settings = None, model_name: ModelName = None) -> None:
    """Build a model and find its consistent start, without integrating."""
    model = _model(path, model_name, settings)
    from beamdae.parts.mechanism import Mechanism
    from beamdae.report import terminal

    mechanism = model()
    parts = mechanism.parts if isinstance(mechanism, Mechanism) else {}
    facts = _start_facts(mechanism, model.t_end)
    for name, part in parts.items():
        facts |= {f"{name}, {what}": value for what, value in part.facts.items()}
    screen = console()
    screen.print(model.name, style="bold")
    if parts:
        kinds = [(name, type(part).__name__) for name, part in parts.items()]
        screen.print(terminal.listing(("part", "kind"), kinds))
    screen.print(terminal.facts("", facts))


@app.command("list")
def list_models(
    path: Annotated[Path, typer.Argument(metavar="PATH", help="Folder or model file.")],
) -> None:
    """List models with their parameters, defaults and end times."""
    if path.is_dir():
        files = sorted(path.glob("*.py"))
    elif path.exists() or path.suffix == ".py":
        files = [path]
    else:
        raise BeamdaeError(f"{path}: there is no such file or folder.")
    from beamdae.cli import model_file
    from beamdae.report import terminal

    rows = []
    for file in files:
        try:
            models = model_file.models_in(file)
        except BeamdaeError as problem:
            if not path.is_dir():
                raise
            rows.append((file.name, "-", str(problem), "-"))
            continue
        for name, model in models.items():
            values = ", ".join(f"{k}={v}" for k, v in model.parameters.items())
            rows.append((name, f"{model.t_end:g}", model.summary, values))
    if not rows:
        raise BeamdaeError(f"{path}: it holds no model.")
    console().print(terminal.listing(("model", "t_end [s]", "about", "parameters"), rows))


def _start_facts(mechanism: Any, t_end: float) -> dict[str, Any]:
    """Size of the equations of motion and what their consistent start is."""
    import numpy as np

    from beamdae.integrators.route import plan
    from beamdae.simulation import as_equations

    equations = as_equations(mechanism)
    state = plan(equations, np.array([0.0, t_end])).state
    moved = float(np.max(np.abs(state.q - equations.q0)))
    return {
        "coordinates": equations.n,
        "constraints": equations.m,
        "degrees of freedom": equations.n - equations.m,
        "characteristic length": f"{equations.length:.4g} m",
        "breakpoints": ", ".join(f"{b:g} s" for b in equations.breakpoints) or "none",
        "consistent start": f"found, coordinates moved by up to {moved:.3g} (m or rad)",
        "largest start reaction": float(np.max(np.abs(state.lam), initial=0.0)),
    }


def _model(path: Path, name: str | None, settings: list[str] | None) -> Model:
    """The model of a file with the values of --set as its defaults."""
    from beamdae.cli.model_file import load_model

    model = load_model(path, name)
    return replace(model, parameters=model.complete(assignments(settings)))


def _errors(solution: Solution, estimate: bool, verify: bool) -> tuple[Any, str]:
    """How far the observed columns are off, if that is asked for, and what to say of it."""
    from beamdae import verification

    if solution.status.kind == "interrupted" or not (estimate or verify):
        return None, ""
    find = verification.verify if verify else verification.error_estimate
    errors = find(solution)
    return errors, verification.exceeded(solution, errors)


def _integrator(name: str, options: dict[str, Any]) -> Any:
    from beamdae.integrators import Auto, GeneralizedAlpha, Ida, Radau

    kinds: dict[str, Any] = {
        "auto": Auto,
        "ida": Ida,
        "radau": Radau,
        "generalized-alpha": GeneralizedAlpha,
    }
    kind = kinds[one_of("run", "--integrator", name, tuple(kinds))]
    given = {option: value for option, value in options.items() if value is not None}
    for option in given:
        if option not in _settings(kind):
            flag = option.replace("_", "-")
            have = [other for other, kind in kinds.items() if option in _settings(kind)]
            raise BeamdaeError(
                f"run: --{flag} is no option of --integrator {name}, but of {' and '.join(have)}."
            )
    return kind(**given)


def _settings(kind: Any) -> set[str]:
    return {field.name for field in fields(kind)}


@contextmanager
def _progress(t_end: float) -> Iterator[Callable[[str, float], None] | None]:
    """A bar of the time reached, on stderr, if that is a terminal."""
    # Standard output is for tables, and may be a file.
    screen = Console(stderr=True)
    if not screen.is_terminal:
        yield None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("t = {task.completed:.3g} of {task.total:.3g} s"),
        TimeElapsedColumn(),
    )
    with Progress(
        *columns, console=screen, transient=True, redirect_stdout=False, redirect_stderr=False
    ) as bar:
        task = bar.add_task("", total=t_end)
        yield lambda label, t: bar.update(task, description=label, completed=t)
