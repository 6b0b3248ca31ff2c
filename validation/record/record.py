"""Benchmark of record for flexible planar mechanisms: solve, score, rebuild, validate.

python record.py validate
python record.py solve plain hub_beam_60 --setting fine
python record.py solve beamdae all --setting Auto
python record.py score
python record.py rebuild all --exudyn-python PATH
"""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import scorer
from scorer import TIME

PROBLEMS, REFERENCES = HERE / "problems.json", HERE / "references.csv"
CONFIRMATIONS, RESULTS = HERE / "confirmations.json", HERE / "results"
AGREEMENT = 1e-4  # of half the range of each column, required of two codes

# Elements per beam and steps per row of the reference; two thirds of both in the second run.
REFINEMENT = {
    "arch_snap": (12, 6),
    "cantilever_gravity": (12, 24),
    "deep_arch": (8, 6),
    "deep_arch_static": (18, 3),
    "double_four_bar": (1, 12),
    "drop_on_stop": (6, 12),
    "flying_beam": (24, 12),
    "friction_block": (6, 12),
    "iftomm_a01": (1, 12),
    "lee_frame_static": (6, 3),
    "parallelogram_stage_static": (12, 3),
    "princeton_cantilever": (6, 3),
    "roll_up_static": (6, 3),
    "spin_up": (6, 15),
    "spring_cart_arm": (6, 24),
}
DEFAULT_REFINEMENT = (6, 6)
# Settings of each tool, and their elements per beam. The first entries of beamdae and Exudyn
# confirm the references.
SETTINGS = {
    "plain": {"fine": 0, "coarse": 0},
    "exudyn": {"fine": 96, "": 32},
    "beamdae": {
        "Radau 1e-8 exact": 12,
        "Auto": 8,
        "refine 0.01": 8,
        "refine 0.001": 8,
        "Ida": 8,
        "Radau": 8,
        "GeneralizedAlpha": 8,
    },
}
CONFIRMING = {"beamdae": "Radau 1e-8 exact", "exudyn": "fine"}
# Factors of the elements above for short elements between attachments, and for waves.
CONFIRMING_FACTORS = {
    "arch_snap": 2,
    "cantilever_gravity": 2,
    "deep_arch_static": 2,
    "flying_beam": 3,
}
# Settings of beamdae that differ only in the integrator.
INTEGRATORS = ("Ida", "Radau", "GeneralizedAlpha")
# Runs that are references, not results.
UNSCORED = ("plain_fine",)
# First columns of scores.md.
FIRST = ("beamdae_Auto", "beamdae_refine_0.01", "beamdae_refine_0.001")

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)
Names = Annotated[list[str], typer.Argument(help="Names of mechanisms, or all.")]


@cache
def _read_problems() -> dict[str, dict[str, Any]]:
    problems: dict[str, dict[str, Any]] = json.loads(PROBLEMS.read_text())
    return problems


def load_problem(name: str) -> dict[str, Any]:
    """Return a copy of the problem of a mechanism."""
    if name not in _read_problems():
        choices = ", ".join(all_names())
        raise typer.BadParameter(f"{name}: unknown mechanism; choose from {choices}.")
    return deepcopy(_read_problems()[name])


def all_names() -> list[str]:
    """Return the names of all mechanisms."""
    return sorted(_read_problems())


def checksum(problem: dict[str, Any]) -> str:
    """Return the checksum of a problem, independent of the form of its file."""
    text = json.dumps(problem, sort_keys=True)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def expand(names: list[str]) -> list[str]:
    """Return the given names, or all for `all`; unknown names are errors."""
    if names == ["all"]:
        return all_names()
    for name in names:
        load_problem(name)
    return names


def run_tool(tool: str, problem: dict[str, Any], setting: str, elements: int) -> Any:
    """Return the table and the information of one run; adapters import their tool."""
    if tool == "plain":
        import plain_beams

        elements, steps = REFINEMENT.get(problem["name"], DEFAULT_REFINEMENT)
        if setting == "coarse":
            elements, steps = max(1, 2 * elements // 3), 2 * steps // 3
        run = plain_beams.solve(problem, elements, steps)
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


def applies(tool: str, setting: str, problem: dict[str, Any]) -> bool:
    """Return False for integrators of beamdae in static problems."""
    is_static = problem.get("analysis") == "static"
    return not (is_static and tool == "beamdae" and setting in INTEGRATORS)


def default_elements(tool: str, setting: str, name: str) -> int:
    """Return the number of elements per beam in the table of results."""
    factor = CONFIRMING_FACTORS.get(name, 1) if CONFIRMING.get(tool) == setting else 1
    return SETTINGS.get(tool, {}).get(setting, 8) * factor


@app.command()
def solve(
    tool: Annotated[str, typer.Argument(help="plain, beamdae or exudyn.")],
    names: Names,
    setting: Annotated[str, typer.Option(help="beamdae: Auto, Radau 1e-8, refine 0.01 ...")] = "",
    elements: Annotated[int, typer.Option(help="Elements per beam; 0: as in the table.")] = 0,
    results: Annotated[Path, typer.Option(help="Folder of results.")] = RESULTS,
) -> None:
    """Solve mechanisms with one tool and write results/TOOL_SETTING/NAME.csv and .json."""
    folder = results / folder_name(tool, setting)
    folder.mkdir(parents=True, exist_ok=True)
    for name in expand(names):
        problem, file = load_problem(name), folder / f"{name}.json"
        count = elements or default_elements(tool, setting, name)
        if not applies(tool, setting, problem):
            continue
        try:
            table, information = run_tool(tool, problem, setting, count)
        except Exception as error:
            # A failed run is a row of the table.
            table, information = pd.DataFrame(), {"success": False, "reason": str(error)}
        file.with_suffix(".csv").unlink(missing_ok=True)
        if len(table):
            table.to_csv(file.with_suffix(".csv"), index=False, float_format="%.10g")
        file.write_text(json.dumps(information, indent=1) + "\n")
        cost = information.get("processor_time", float("nan"))
        typer.echo(f"{name}: {cost:.2f} s {information['reason']}"[:150])


@app.command()
def score(
    results: Annotated[Path, typer.Option(help="Folder TOOL/NAME.csv of results.")] = RESULTS,
) -> None:
    """Score all results: scores.csv and scores.md.

    Rows of scores.csv without a run in the folder are kept: runs are not part of the repository.
    """
    file = results / "scores.csv"
    scores = scorer.score_all(scorer.read_references(REFERENCES), results)
    if scores.empty:
        raise typer.BadParameter(f"{results}: contains no runs; add runs with `solve`.")
    scores = scores[~scores["tool"].isin(UNSCORED)]
    if file.exists():
        stored = pd.read_csv(file)
        stored = stored[stored["mechanism"].isin(all_names())]
        scores = pd.concat([stored, scores]).drop_duplicates(["tool", "mechanism"], keep="last")
    scores = scores.sort_values(["tool", "mechanism"])
    scores.to_csv(file, index=False, float_format="%.4g")
    # The table shows the stored digits, with and without the runs.
    scores = read_scores(file)
    scorer.write_markdown(scores, results / "scores.md", FIRST)
    summary = scores.groupby("tool")["error"].agg(["count", "median", "max"])
    typer.echo(summary.to_string())


def read_scores(file: Path) -> pd.DataFrame:
    """Return the table of scores.csv."""
    return pd.read_csv(file).fillna({"worst column": "", "reason": ""})


def read_confirmations() -> dict[str, Any]:
    """Return the stored confirmations by name of the mechanism."""
    return json.loads(CONFIRMATIONS.read_text())


def stored_code(name: str, tool: str) -> dict[str, Any] | None:
    """Return the stored entry of a confirming tool; None if the problem has changed since."""
    confirmation = read_confirmations().get(name)
    if confirmation is None or confirmation["problem"] != checksum(load_problem(name)):
        return None
    codes: list[dict[str, Any]] = confirmation["codes"]
    return next((code for code in codes if code["tool"] == tool), None)


def write_reference(name: str, kept: Sequence[str] = ()) -> None:
    """Write reference, uncertainty and confirmation from the runs of all codes.

    The refinement part of the uncertainty is the change from two thirds of the elements and steps,
    which exceeds the error of any method of at least second order. The uncertainty is the larger of
    this part and the difference from the best second code. Both are running maxima in time.

    The tools of `kept` are not evaluated: their entries in confirmations.json are those of the last
    confirmation, as long as the problem is the same. If such a tool agrees best, the stored
    uncertainty bounds its difference.
    """
    fine, coarse = (pd.read_csv(RESULTS / f"plain_{x}" / f"{name}.csv") for x in ("fine", "coarse"))
    setting = REFINEMENT.get(name, DEFAULT_REFINEMENT)
    half = scorer.half_ranges(fine)
    refinement = (coarse - fine).abs().cummax()
    codes, best = [], None
    for tool, tool_setting in CONFIRMING.items():
        file = RESULTS / folder_name(tool, tool_setting) / f"{name}.csv"
        code: dict[str, Any] = {"tool": tool, "setting": tool_setting}
        if tool in kept:
            stored = stored_code(name, tool)
            codes += [stored] if stored else []
            largest = stored and stored["largest"]
            if largest is not None and (best is None or largest < best[0]):
                best = largest, scorer.read_references(REFERENCES)[name][1]
            continue
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
    relative = refinement_error = float((refinement.drop(columns=TIME).max() / half).max())
    if best is not None:
        relative = max(relative, best[0])
    confirmation = {
        "problem": checksum(load_problem(name)),
        "status": "confirmed" if best is not None and relative <= AGREEMENT else "open",
        "code": "plain",
        "elements": setting[0],
        "steps_per_row": setting[1],
        "refinement": refinement_error,
        "uncertainty": relative,
        "codes": codes,
    }
    rows = fine.map("{:.10g}".format).melt(TIME, var_name="column")
    rows["uncertainty"] = uncertainty.map("{:.1e}".format).melt(TIME)["value"]
    stored = pd.read_csv(REFERENCES, dtype=str)
    others = stored[stored["mechanism"] != name]
    table = pd.concat([others, rows.assign(mechanism=name)[stored.columns]])
    table.sort_values("mechanism", kind="stable").to_csv(REFERENCES, index=False)
    confirmations = dict(sorted((read_confirmations() | {name: confirmation}).items()))
    CONFIRMATIONS.write_text(json.dumps(confirmations, indent=1) + "\n")


@app.command()
def rebuild(
    names: Names,
    exudyn_python: Annotated[str, typer.Option(help="Python with exudyn.")] = sys.executable,
    workers: Annotated[int, typer.Option(help="Number of processes.")] = 2,
    without_exudyn: Annotated[
        bool, typer.Option("--without-exudyn", help="Keep the stored results of Exudyn.")
    ] = False,
) -> None:
    """Run all tools, then write references, scores and tables."""
    chosen = expand(names)
    kept = ("exudyn",) if without_exudyn else ()
    if not without_exudyn:
        require_exudyn(exudyn_python)
    commands = [
        [tool, name, "--setting", setting]
        for setting in SETTINGS["plain"]
        for tool, name in [("plain", x) for x in chosen]
    ]
    commands += [
        [tool, *chosen, "--setting", setting]
        for tool in SETTINGS
        if tool not in ("plain", *kept)
        for setting in SETTINGS[tool]
    ]
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(lambda x: run_solve(x, exudyn_python), commands))
    for name in chosen:
        write_reference(name, kept)
    score(RESULTS)


def require_exudyn(python: str) -> None:
    """Raise an error if Exudyn cannot be imported: failures would replace its stored results."""
    try:
        subprocess.run([python, "-c", "import exudyn"], capture_output=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        raise typer.BadParameter(
            f"exudyn: {python} cannot import it; set --exudyn-python, or keep its stored results "
            "by --without-exudyn."
        ) from None


def run_solve(arguments: list[str], exudyn_python: str) -> None:
    """Run `solve` in a process of its own, with one thread for linear algebra."""
    python = exudyn_python if arguments[0] == "exudyn" else sys.executable
    command = [python, str(HERE / "record.py"), "solve", *arguments]
    limits = {f"{x}_NUM_THREADS": "1" for x in ("OPENBLAS", "OMP", "MKL")}
    subprocess.run(command, check=False, env=os.environ | limits)


@app.command()
def validate(names: Annotated[list[str] | None, typer.Argument()] = None) -> None:
    """Check schema, confirmed problems and tables of all mechanisms."""
    problems = check(names or all_names())
    for message in problems:
        typer.echo(message)
    typer.echo(f"{len(names or all_names())} mechanisms, {len(problems)} problems")
    raise typer.Exit(bool(problems))


def check(names: Iterable[str]) -> list[str]:
    """Return one sentence per problem of the mechanisms."""
    import jsonschema

    schema = json.loads((HERE / "problem.schema.json").read_text())
    confirmations, references = read_confirmations(), scorer.read_references(REFERENCES)
    messages = []
    for name in names:
        problem = load_problem(name)
        errors = jsonschema.Draft202012Validator(schema).iter_errors(problem)
        messages += [f"problems.json, {name}: {error.message}" for error in errors]
        if confirmations[name]["problem"] != checksum(problem):
            messages.append(f"problems.json, {name}: differs from the confirmed problem.")
        reference, uncertainty = references[name]
        if pd.concat([reference, uncertainty]).isna().any(axis=None):
            messages.append(f"references.csv, {name}: a value or an uncertainty is missing.")
        rows = round(problem["time"]["end"] / problem["time"]["output_step"]) + 1
        if len(reference) != rows:
            messages.append(f"references.csv, {name}: has {len(reference)} times, not {rows}.")
    return messages


if __name__ == "__main__":
    app()
