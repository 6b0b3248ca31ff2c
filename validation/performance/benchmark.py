"""Time runs relative to Exudyn, to another version, and to their own operations.

    python validation/performance/benchmark.py --peer PYTHON --before PATH
    python validation/performance/benchmark.py --quick
    python validation/performance/benchmark.py --linear   dense against sparse factorization
    python validation/performance/benchmark.py --commands   whole processes and that of Exudyn

PYTHON is an interpreter with Exudyn (`pip install exudyn`), and PATH is a checkout of beamdae; the
tables of a missing tool are omitted. "price of Python" is the time of a run without a pilot run,
divided by the time of its counted residuals, matrices, factorizations and solutions back to back
(`operations`). "in loops" is the part of the run within machine code. "setup" and "books" (energy
balance, drift and residual of a run) are measured once. All times except "wall" and "setup" are
processor times, the smallest of several turns where actions take turns.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

MODELS_FOLDER = Path(__file__).parents[2] / "models"
sys.path.insert(0, str(MODELS_FOLDER))

import numpy as np
import pandas as pd
import scipy.sparse as sp
from benchmark_systems import beam
from hub_beam import hub_beam
from measurement import (
    RESULTS,
    TimeSamples,
    environment_of_users,
    processor_time_of_children,
    time_action,
    time_in_turns,
    time_integration,
    time_within_loops,
    write_table,
)
from operations import (
    OPERATIONS,
    TIME_AND_BRANCH,
    OperationTimers,
    time_first_order_operations,
    time_step_operations,
)
from pendulum import pendulum
from slider_crank import slider_crank
from workers import Worker, has_exudyn, start_checkout, start_exudyn

import beamdae as bd
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.step_equations import StepPrediction, formulate_step
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.linear.blas_threads import single_threaded
from beamdae.linear.factorizations import DenseFactorization, SparseFactorization
from beamdae.results.outcome import Statistics

MODELS_BY_NAME = {"hub_beam": hub_beam, "pendulum": pendulum, "slider_crank": slider_crank}
Systems = tuple[tuple[str, dict[str, Any]], ...]
SYSTEMS: Systems = (
    ("hub_beam", {}),
    ("pendulum", {"damping": 0.0}),
    ("slider_crank", {"frame": "chord"}),
)
INTEGRATORS = (bd.GeneralizedAlpha(1e-3), bd.Ida(1e-5), bd.Radau(1e-4))
# Options of `beamdae run`.
RUN_OPTIONS = ((), ("--no-estimate",), ("--no-picture",), ("--no-estimate", "--no-picture"))
# The same run as a script that writes the table.
SCRIPT = f"""import sys

import beamdae as bd

sys.path.insert(0, {str(MODELS_FOLDER)!r})
from hub_beam import hub_beam

bd.simulate(hub_beam).to_csv("hub_beam.csv")
"""
# Run of Exudyn with errors of 0.1 mm, whose path of the tip is printed.
EXUDYN_RUN = {"system": "hub beam", "elements": 6, "nodes": 3, "step": 2e-3}
# Step and rate at which operations are evaluated; the times do not depend on them.
STEP = 1e-3  # s
RATE = 2e3  # 1/s


def make_call_timer(
    equations: bd.results.EquationsOfMotion,
    integrator: bd.Integrator,
    statistics: Statistics,
) -> Callable[[], float]:
    """Return a function that measures the time of a run's counted calls, back to back [s]."""
    counts = dict(
        zip(
            OPERATIONS,
            (
                statistics.residual_calls,
                statistics.jacobian_calls,
                statistics.factorizations,
                statistics.solves,
            ),
            strict=True,
        )
    )
    if isinstance(integrator, bd.GeneralizedAlpha):
        return partial(_sum_call_times, [(time_step_operations(equations, STEP, 200), counts)])
    real = time_first_order_operations(equations, RATE, 200)
    if isinstance(integrator, bd.Ida):
        return partial(_sum_call_times, [(real, counts)])
    # An iteration of Radau takes three residuals, a real and a complex solution. Its matrices come
    # in pairs, a real and a complex one; solutions for the error estimate are real.
    pair = time_first_order_operations(equations, complex(RATE, RATE), 200)
    of_pair = {"factorize": statistics.factorizations // 2, "solve": statistics.residual_calls // 3}
    counts = {name: count - of_pair.get(name, 0) for name, count in counts.items()}
    return partial(_sum_call_times, [(real, counts), (pair, of_pair)])


def _sum_call_times(parts: list[tuple[OperationTimers, dict[str, int]]]) -> float:
    return sum(count * timers[name]() for timers, counts in parts for name, count in counts.items())


@single_threaded
def time_runs(rounds: int, systems: Systems = SYSTEMS) -> pd.DataFrame:
    """Return integration times of the published systems, relative to their operations."""
    rows = []
    for name, parameters in systems:
        model = MODELS_BY_NAME[name]
        equations = bd.equations_of_motion(model(**parameters))
        # With given scales there is no pilot run, whose calls would not be counted.
        equations = replace(equations, scales=equations.position_scales)
        times = np.linspace(0.0, model.t_end, 201)
        for integrator in INTEGRATORS:
            _, solution = time_integration(equations, integrator, times)
            statistics = solution.statistics
            in_loops = TimeSamples()
            actions = {
                "run": partial(_time_run, equations, integrator, times, in_loops),
                "calls": make_call_timer(equations, integrator, statistics),
            }
            samples = time_in_turns(actions, rounds)
            run, calls = samples["run"], samples["calls"]
            rows.append(
                {
                    "run": f"{name}, {integrator.label}",
                    "steps": statistics.steps,
                    "run [s]": run.least,
                    "in loops [s]": in_loops.least,
                    "calls [s]": calls.least,
                    "price of Python": run.least / calls.least,
                    "of medians": run.median / calls.median,
                    "loops / calls": in_loops.least / calls.least,
                    "setup [s]": statistics.setup_time,
                    "books [s]": time_action(lambda of=solution: of.quality),
                }
            )
    return pd.DataFrame(rows)


def _time_run(
    equations: bd.results.EquationsOfMotion,
    integrator: bd.Integrator,
    times: np.ndarray,
    in_loops: TimeSamples,
) -> float:
    """Return the time of a run; the part within compiled loops is added to `in_loops`."""
    whole, inside = time_within_loops(equations, integrator, times)
    in_loops.all.append(inside)
    return whole


def compare_with_exudyn(peer: Worker, rounds: int) -> pd.DataFrame:
    """Compare eight elements of beamdae with eight of Exudyn, of three nodes, at one step."""
    rows = []
    for name, system in (("hub_beam", "hub beam"), ("pendulum", "pendulum")):
        model = MODELS_BY_NAME[name]
        equations = bd.equations_of_motion(model(elements=8, damping=0.0))
        times = np.linspace(0.0, model.t_end, round(model.t_end / 0.01) + 1)
        job = {"system": system, "elements": 8, "nodes": 3, "step": 1e-3, "path": False}
        actions = {
            "beamdae": partial(_time_beamdae, equations, bd.GeneralizedAlpha(1e-3), times),
            "Exudyn": lambda job=job: peer(**job)["integrate"],
        }
        samples = time_in_turns(actions, rounds)
        rows.append({"run": f"{name}, step=1e-3", **_ratio_columns(samples, "beamdae", "Exudyn")})
    return pd.DataFrame(rows)


def _time_beamdae(
    equations: bd.results.EquationsOfMotion, integrator: bd.Integrator, times: np.ndarray
) -> float:
    return time_integration(equations, integrator, times)[0]


def compare_with_checkout(folder: Path, rounds: int, systems: Systems = SYSTEMS) -> pd.DataFrame:
    """Compare runs of another checkout with runs of this one."""
    rows = []
    with start_checkout(folder) as before, start_checkout(MODELS_FOLDER.parent) as now:
        for name, parameters in systems:
            for integrator, settings in (
                ("Ida", {"rtol": 1e-5}),
                ("Radau", {"rtol": 1e-4}),
                ("GeneralizedAlpha", {"step": 1e-3}),
            ):
                job = {
                    "model": name,
                    "parameters": parameters,
                    "integrator": integrator,
                    "settings": settings,
                }
                actions = {
                    "now": lambda job=job: now(**job)["integrate"],
                    "before": lambda job=job: before(**job)["integrate"],
                }
                samples = time_in_turns(actions, rounds)
                line = {"run": f"{name}, {getattr(bd, integrator)(**settings).label}"}
                rows.append({**line, **_ratio_columns(samples, "now", "before")})
    return pd.DataFrame(rows)


def _ratio_columns(samples: dict[str, TimeSamples], one: str, other: str) -> dict[str, float]:
    return {
        f"{one} [s]": samples[one].least,
        f"{other} [s]": samples[other].least,
        "ratio": samples[one].least / samples[other].least,
        "of medians": samples[one].median / samples[other].median,
    }


def time_building() -> pd.DataFrame:
    """Return times from a model to its equations, and to the first step."""
    rows = []
    for elements in (8, 32, 128, 512):
        mechanism = hub_beam(elements=elements)
        build_times = [
            time_action(lambda mechanism=mechanism: bd.equations_of_motion(mechanism))
            for _ in range(3)
        ]
        first_step_times = []
        for _ in range(3):
            equations = bd.equations_of_motion(mechanism)
            whole = time_action(
                lambda of=equations: bd.GeneralizedAlpha(1e-3).integrate(of, np.array([0.0, 1e-3]))
            )
            first_step_times.append(whole)
        rows.append(
            {
                "elements": elements,
                "equations [s]": min(build_times),
                "first step [s]": min(first_step_times),
            }
        )
    return pd.DataFrame(rows)


def time_commands(rounds: int, peer: str) -> pd.DataFrame:
    """Return times of commands and of a script with warm caches, from the shell to their end.

    "table after" is the time of the first output: `beamdae run` prints the table before it writes
    the page and the picture. The processes, and one of Exudyn if it is installed, take turns.
    """
    best: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        model, script = str(MODELS_FOLDER / "hub_beam.py"), Path(folder, "script.py")
        script.write_text(SCRIPT)
        processes = {"python script.py": [sys.executable, str(script)]}
        for options in RUN_OPTIONS:
            name = " ".join(["run hub_beam.py", *options])
            processes[name] = [sys.executable, "-m", "beamdae", "run", model, *options]
        for name in ("check", "draw", "list"):
            processes[f"{name} hub_beam.py"] = [sys.executable, "-m", "beamdae", name, model]
        if has_exudyn(peer):
            peer_script = str(Path(__file__).with_name("exudyn_peer.py"))
            processes["Exudyn"] = [peer, peer_script, json.dumps(EXUDYN_RUN)]
        for k in range(rounds + 1):
            for name, command in processes.items():
                times = _time_process(command, folder)
                if k:  # the first turn fills the caches
                    row = best.setdefault(name, times)
                    row.update({x: min(time, times[x]) for x, time in row.items()})
    table = pd.DataFrame([{"process": name} | times for name, times in best.items()])
    if "Exudyn" in best:
        table["processor / Exudyn"] = table["processor [s]"] / best["Exudyn"]["processor [s]"]
    return table


def _time_process(command: list[str], folder: str) -> dict[str, float]:
    used, begin = processor_time_of_children(), time.perf_counter()
    process = subprocess.Popen(
        command, cwd=folder, env=environment_of_users(), stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    process.stdout.read1()
    to_table = time.perf_counter() - begin
    process.communicate()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    return {
        "table after [s]": to_table,
        "wall [s]": time.perf_counter() - begin,
        "processor [s]": processor_time_of_children() - used,
    }


def _time_factorization(
    pattern: sp.csc_array, method: type, nonzeros: np.ndarray
) -> tuple[float, float]:
    solver, right = method(pattern), np.ones(pattern.shape[0])
    solver.factorize(nonzeros)
    factorize = min(
        time_action(lambda: [solver.factorize(nonzeros) for _ in range(20)]) for _ in range(5)
    )
    solve = min(time_action(lambda: [solver.solve(right) for _ in range(50)]) for _ in range(5))
    return factorize / 20, solve / 50


@single_threaded
def compare_factorizations() -> pd.DataFrame:
    """Compare factorization and solution by LAPACK and by SuperLU."""
    rows = []
    for elements in (4, 8, 11, 16, 32, 64):
        equations = bd.equations_of_motion(beam(elements))
        start = ConsistencySolver(equations).state(TIME_AND_BRANCH, equations.q0, equations.v0)
        ida, alpha = (
            formulate_first_order(equations, "stabilized-index1"),
            formulate_step(equations, False),
        )
        coefficients = np.array([2e3, 3e6, 3e-7])
        at = StepPrediction(start.q, start.v, start.a, start.q.copy(), coefficients)
        for name, form, nonzeros in (
            ("Ida", ida, ida.jacobian(TIME_AND_BRANCH, *ida.pack(start), RATE)),
            ("GeneralizedAlpha", alpha, alpha.jacobian(TIME_AND_BRANCH, at, np.zeros(alpha.size))),
        ):
            row = {"form": name, "unknowns": form.size, "non-zeros": form.pattern.nnz}
            methods = {"dense": DenseFactorization, "sparse": SparseFactorization}
            for method, factorization in methods.items():
                factorize, solve = _time_factorization(form.pattern, factorization, nonzeros)
                row[f"{method} factorize [us]"] = round(factorize * 1e6)
                row[f"{method} solve [us]"] = round(solve * 1e6, 1)
            rows.append(row)
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--linear", action="store_true")
    parser.add_argument("--commands", action="store_true")
    parser.add_argument("--peer", default=sys.executable, help="an interpreter with Exudyn")
    parser.add_argument("--before", type=Path, help="a checkout to compare with")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the tables")
    options = parser.parse_args()
    if options.linear:
        print(compare_factorizations().to_string(index=False))
        return
    rounds = 2 if options.quick else 6
    if options.commands:
        write_table(options.out, "commands", time_commands(rounds, options.peer))
        return
    write_table(options.out, "price_of_python", time_runs(rounds))
    peer = start_exudyn(options.peer)
    if peer is not None:
        with peer:
            write_table(options.out, "beside_exudyn", compare_with_exudyn(peer, 2 * rounds))
    if options.before is not None:
        write_table(options.out, "beside_before", compare_with_checkout(options.before, rounds))
    write_table(options.out, "building", time_building())
    write_table(options.out, "commands", time_commands(rounds, options.peer))


if __name__ == "__main__":
    main()
