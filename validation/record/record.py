"""Benchmark of record for flexible planar mechanisms: solve, score, rebuild, validate.

python record.py validate
python record.py solve plain hub_beam_60
python record.py solve beamdae all --setting Auto
python record.py score
python record.py rebuild all --exudyn-python PATH
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import documents
import scorer
from scorer import TIME

MECHANISMS, RESULTS = HERE / "mechanisms", HERE / "results"
AGREEMENT = 1e-4  # of half the range of each column, required of two codes

# Elements per beam and steps per row of the reference; two thirds of both in the second run.
REFINEMENT = {
    "arch_snap": (12, 6),
    "cantilever_gravity": (6, 24),
    "deep_arch": (8, 6),
    "flying_beam": (6, 18),
    "spin_up": (6, 15),
    "spring_cart_arm": (6, 24),
}
DEFAULT_REFINEMENT = (6, 6)
# Second codes; Exudyn may be installed in a separate environment.
CONFIRMING = {"beamdae": ("Radau 1e-8 exact", 12), "exudyn": ("fine", 96)}
CONFIRMING_FACTORS = {"arch_snap": 2}  # of the elements above; short elements between attachments

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)
Names = Annotated[list[str], typer.Argument(help="Names of mechanisms, or all.")]


def load_problem(name: str) -> dict[str, Any]:
    """Return the problem of a mechanism."""
    path = MECHANISMS / name / "problem.json"
    if not path.exists():
        choices = ", ".join(all_names())
        raise typer.BadParameter(f"{name}: unknown mechanism; choose from {choices}.")
    return json.loads(path.read_text())


def all_names() -> list[str]:
    """Return the names of all mechanisms."""
    return sorted(path.parent.name for path in MECHANISMS.glob("*/problem.json"))


def expand(names: list[str]) -> list[str]:
    """Return the given names, or all for `all`."""
    return all_names() if names == ["all"] else names


def run_tool(tool: str, problem: dict[str, Any], setting: str, elements: int) -> Any:
    """Return the table and the information of one run; adapters import their tool."""
    if tool == "plain":
        import plain_beams

        run = plain_beams.solve(problem, elements, int(setting or DEFAULT_REFINEMENT[1]))
        return pd.DataFrame(run["columns"]), {"success": True, "reason": ""} | run["statistics"]
    if tool == "exudyn":
        from adapters import exudyn_adapter

        steps_per_row = {"": 10, "fine": 40}[setting]
        step = problem["time"]["output_step"] / steps_per_row
        return exudyn_adapter.solve(problem, elements, step)
    from adapters import beamdae_adapter

    formulation = "exact" if setting.endswith(" exact") else "default"
    setting = setting.removesuffix(" exact") or "Auto"
    return beamdae_adapter.solve(problem, setting, elements, formulation)


def folder_name(tool: str, setting: str) -> str:
    """Return the name of the folder of results."""
    return "_".join([tool, *setting.split()])


@app.command()
def solve(
    tool: Annotated[str, typer.Argument(help="plain, beamdae or exudyn.")],
    names: Names,
    setting: Annotated[str, typer.Option(help="beamdae: Auto, Radau 1e-8, certify 0.01 ...")] = "",
    elements: Annotated[int, typer.Option(help="Elements per beam.")] = 8,
) -> None:
    """Solve mechanisms with one tool and write results/TOOL_SETTING/NAME.csv and .json."""
    folder = RESULTS / folder_name(tool, setting)
    folder.mkdir(parents=True, exist_ok=True)
    for name in expand(names):
        problem = load_problem(name)
        try:
            table, information = run_tool(tool, problem, setting, elements)
        except Exception as error:
            # A failed run is a row of the table.
            table, information = pd.DataFrame(), {"success": False, "reason": str(error)}
        (folder / f"{name}.csv").unlink(missing_ok=True)
        if len(table):
            table.to_csv(folder / f"{name}.csv", index=False, float_format="%.10g")
        (folder / f"{name}.json").write_text(json.dumps(information, indent=1) + "\n")
        cost = information.get("processor_time", float("nan"))
        typer.echo(f"{name}: {cost:.2f} s {information['reason']}"[:150])


@app.command()
def score(
    results: Annotated[Path, typer.Option(help="Folder TOOL/NAME.csv of results.")] = RESULTS,
) -> None:
    """Score all results: scores.csv, scores.md, results.html and work_precision.png."""
    scores = scorer.score_all(MECHANISMS, results)
    scores.to_csv(results / "scores.csv", index=False, float_format="%.4g")
    scorer.plot_work_precision(scores, results / "work_precision.png")
    scorer.write_page(scores, results / "results.html")
    first = ["beamdae_Auto", "beamdae_certify_0.01", "beamdae_certify_0.001"]
    scorer.write_markdown(scores, results / "scores.md", first)
    summary = scores.groupby("tool")["error"].agg(["count", "median", "max"])
    typer.echo(summary.to_string())


def refine(problem: dict[str, Any], elements: int, substeps: int) -> dict[str, pd.DataFrame]:
    """Return two runs of the plain code, with all and with two thirds of elements and steps."""
    import plain_beams

    settings = {
        "fine": (elements, substeps),
        "coarse": (2 * elements // 3, 2 * substeps // 3),
    }
    return {
        key: pd.DataFrame(plain_beams.solve(problem, *setting)["columns"])
        for key, setting in settings.items()
    }


def write_reference(name: str, runs: dict[str, pd.DataFrame], setting: tuple[int, int]) -> None:
    """Write reference, uncertainty and confirmation from the runs and the stored second codes.

    The refinement part of the uncertainty is the change from two thirds of the elements and steps,
    which exceeds the error of any method of at least second order. The uncertainty is the larger of
    this part and the difference from the best second code. Both are running maxima in time.
    """
    folder, fine = MECHANISMS / name, runs["fine"]
    half = scorer.half_ranges(fine)
    refinement = (runs["coarse"] - fine).abs().cummax()
    codes, best = [], None
    for tool, (tool_setting, _) in CONFIRMING.items():
        file = RESULTS / folder_name(tool, tool_setting) / f"{name}.csv"
        code: dict[str, Any] = {"tool": tool, "setting": tool_setting}
        information = json.loads(file.with_suffix(".json").read_text())
        if not file.exists() or not information["success"]:
            code |= {"largest": None, "column": information["reason"][:80]}
        else:
            difference = (pd.read_csv(file)[fine.columns] - fine).abs().cummax()
            relative = (difference.drop(columns=TIME).max() / half).sort_values()
            code |= {"largest": float(relative.iloc[-1]), "column": str(relative.index[-1])}
            if best is None or code["largest"] < best[0]:
                best = code["largest"], difference
        codes.append(code)
    uncertainty = refinement
    if best is not None:
        uncertainty = pd.DataFrame(np.maximum(refinement, best[1]), columns=fine.columns)
    uncertainty[TIME] = fine[TIME]
    relative = float((uncertainty.drop(columns=TIME).max() / half).max())
    confirmation = {
        "status": "confirmed" if best is not None and relative <= AGREEMENT else "open",
        "code": "plain",
        "elements": setting[0],
        "steps_per_row": setting[1],
        "refinement": float((refinement.drop(columns=TIME).max() / half).max()),
        "uncertainty": relative,
        "codes": codes,
    }
    fine.to_csv(folder / "reference.csv", index=False, float_format="%.10g")
    table = uncertainty.copy()
    for column in table.columns.drop(TIME):
        table[column] = table[column].map("{:.1e}".format)
    table[TIME] = table[TIME].map("{:.10g}".format)
    table.to_csv(folder / "uncertainty.csv", index=False)
    (folder / "confirmation.json").write_text(json.dumps(confirmation, indent=1) + "\n")


def write_documents(name: str) -> None:
    """Write drawing, description and data package of a mechanism."""
    folder, problem = MECHANISMS / name, load_problem(name)
    confirmation = json.loads((folder / "confirmation.json").read_text())
    documents.draw(problem, pd.read_csv(folder / "reference.csv"), folder / "drawing.svg")
    (folder / "description.md").write_text(documents.describe(problem, confirmation))
    documents.write_datapackage(folder)


@app.command()
def rebuild(
    names: Names,
    exudyn_python: Annotated[str, typer.Option(help="Python with exudyn.")] = sys.executable,
    documents_only: Annotated[bool, typer.Option(help="Keep the references.")] = False,
) -> None:
    """Recompute references, confirm them with the second codes and write all files."""
    for name in expand(names):
        if not documents_only:
            setting = REFINEMENT.get(name, DEFAULT_REFINEMENT)
            runs = refine(load_problem(name), *setting)
            for tool, (tool_setting, elements) in CONFIRMING.items():
                python = exudyn_python if tool == "exudyn" else sys.executable
                elements *= CONFIRMING_FACTORS.get(name, 1)
                options = ["--setting", tool_setting, "--elements", str(elements)]
                command = [python, str(HERE / "record.py"), "solve", tool, name, *options]
                subprocess.run(command, check=False)
            write_reference(name, runs, setting)
        write_documents(name)
        typer.echo(name)


@app.command()
def validate(names: Annotated[list[str] | None, typer.Argument()] = None) -> None:
    """Check schema, checksums and tables of all mechanisms; Frictionless if it is installed."""
    problems = [message for name in names or all_names() for message in check(name)]
    for message in problems:
        typer.echo(message)
    typer.echo(f"{len(names or all_names())} mechanisms, {len(problems)} problems")
    raise typer.Exit(bool(problems))


def check(name: str) -> list[str]:
    """Return one sentence per problem of a mechanism."""
    import jsonschema

    folder, problem = MECHANISMS / name, load_problem(name)
    schema = json.loads((HERE / "problem.schema.json").read_text())
    errors = jsonschema.Draft202012Validator(schema).iter_errors(problem)
    messages = [f"{name}/problem.json: {error.message}" for error in errors]
    messages += documents.check_checksums(folder)
    reference = pd.read_csv(folder / "reference.csv")
    uncertainty = pd.read_csv(folder / "uncertainty.csv")
    if list(reference.columns) != list(uncertainty.columns) or len(reference) != len(uncertainty):
        messages.append(f"{name}: reference and uncertainty have different columns or times.")
    rows = round(problem["time"]["end"] / problem["time"]["output_step"]) + 1
    if len(reference) != rows:
        messages.append(f"{name}/reference.csv: has {len(reference)} rows instead of {rows}.")
    return messages


if __name__ == "__main__":
    app()
