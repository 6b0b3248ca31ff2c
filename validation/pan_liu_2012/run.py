"""Recompute Tables 1 and 2 and Figs. 5, 6, 7, 9 and 10 of Pan & Liu (2012).

    python validation/pan_liu_2012/run.py [--out results/pan_liu_2012]
    python validation/pan_liu_2012/run.py --table table_2     print a stored table as CSV

Writes summary.csv, with one row and a verdict for each claim of the paper, all other tables to
tables.json, and figures.png. Wall times are in the table table_2_times and in the columns "wall
time [s]" of other tables.
"""

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

sys.path[:0] = [str(Path(__file__).parents[2] / "models"), str(Path(__file__).parents[1])]

import pandas as pd
from pan_liu_2012 import (
    appendix,
    dissipation,
    dynamic_stiffening,
    figure_5,
    figures_6_7,
    figures_9_10,
    readings,
    steps,
    table_2,
)
from pan_liu_2012.claims import summarize_claims
from pan_liu_2012.plots import draw_all
from rich.console import Console
from stored_columns import write_columns

Tables = dict[str, pd.DataFrame]
RESULTS = Path(__file__).parent / "results"
TIME = "t [s]"
STUDIES = (
    table_2,
    steps,
    figures_6_7,
    figure_5,
    figures_9_10,
    dissipation,
    dynamic_stiffening,
    appendix,
)
CLAIMS = [claim for study in STUDIES for claim in study.CLAIMS]


class Job(NamedTuple):
    """Function that computes tables, and its arguments."""

    name: str
    function: Callable[..., Tables]
    arguments: tuple[Any, ...] = ()


def list_jobs() -> list[Job]:
    """Return all jobs, the longest first."""
    return [
        Job("generalized-alpha", dissipation.compute_dissipation),
        *(
            Job(
                f"table 2, {name}, {subtended:g} degrees, {shape}",
                table_2.compute_errors,
                (name, subtended, shape),
            )
            for name in table_2.INTEGRATORS
            for subtended, shape in table_2.BEAMS
        ),
        Job("figure 5", figure_5.compute_figure_5),
        *(Job("gauge scan", figure_5.scan_gauges, (x,)) for x in figure_5.ORIENTATIONS),
        *(
            Job("figures 9 and 10", figures_9_10.compute_figures_9_10, (crank,))
            for crank in figures_9_10.CRANKS
        ),
        *(
            Job("curved spin-up", dynamic_stiffening.compute_curved_spin_up_errors, (speed,))
            for speed in dynamic_stiffening.SPEEDS
        ),
        *(Job("steps", steps.compute_step_errors, (system,)) for system in steps.SYSTEMS),
        *(Job("readings", readings.compute_hub_readings, (x,)) for x in readings.HUB_READINGS),
        *(Job("readings", readings.compute_crank_readings, (x,)) for x in readings.CRANK_READINGS),
        *(
            Job("figures 6 and 7", figures_6_7.compute_figures_6_7, (angle,))
            for angle in (60.0, 30.0)
        ),
        Job("spin-up", dynamic_stiffening.compute_spin_up),
        Job("table 1", readings.compare_data),
        Job("appendix", appendix.compare_terms),
    ]


def compute_tables(console: Console) -> Tables:
    """Run all jobs in one process a core, and join their parts of tables."""
    begin, jobs = time.perf_counter(), list_jobs()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(mp_context=context) as pool:
        futures = {pool.submit(job.function, *job.arguments): job.name for job in jobs}
        for count, future in enumerate(as_completed(futures), start=1):
            future.result()
            elapsed = time.perf_counter() - begin
            console.print(f"{count:3d} of {len(jobs)}  {elapsed:4.0f} s  {futures[future]}")
    return join_parts(future.result() for future in futures)


def join_parts(parts: Iterable[Tables]) -> Tables:
    """Return the tables of all jobs, joined from their parts, and those that follow from them."""
    by_name: dict[str, list[pd.DataFrame]] = {}
    for tables in parts:
        for name, table in tables.items():
            by_name.setdefault(name, []).append(table)
    joined = {name: join_tables(tables) for name, tables in by_name.items()}
    if "table_2_errors" in joined:
        joined["table_2"] = table_2.compute_table_2(joined["table_2_errors"])
    return joined


def judge_study(study: ModuleType, stored: Tables) -> pd.DataFrame:
    """Return the claims of a study by its own jobs, run one by one, and other `stored` tables."""
    jobs = [job for job in list_jobs() if job.function.__module__ == study.__name__]
    tables = {**stored, **join_parts(job.function(*job.arguments) for job in jobs)}
    return summarize_claims(study.CLAIMS, tables)


def is_history(table: pd.DataFrame) -> bool:
    """Return whether the rows are times."""
    return table.index.name == TIME


def join_tables(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """Join columns of time histories, and rows of other tables."""
    if is_history(tables[0]):
        return pd.concat(tables, axis=1)
    return pd.concat(tables, ignore_index=True)


def write_tables(tables: Tables, folder: Path) -> None:
    """Write the summary to a CSV file, and all other tables to one file."""
    folder.mkdir(parents=True, exist_ok=True)
    tables["summary"].to_csv(folder / "summary.csv", index=False)
    plain = {x: table.reset_index() if is_history(table) else table for x, table in tables.items()}
    columns = {name: plain[name].to_dict("list") for name in sorted(plain) if name != "summary"}
    write_columns(folder / "tables.json", columns, digits=8)


def read_tables() -> Tables:
    """Return the stored tables; the index of time histories is the time."""
    stored = json.loads((RESULTS / "tables.json").read_text("utf-8"))
    tables = {name: pd.DataFrame(columns) for name, columns in stored.items()}
    tables = {x: table.set_index(TIME) if TIME in table else table for x, table in tables.items()}
    return tables | {"summary": pd.read_csv(RESULTS / "summary.csv")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/pan_liu_2012"))
    parser.add_argument("--table", choices=read_tables(), metavar="NAME", help="print a table")
    options = parser.parse_args()
    if options.table:
        table = read_tables()[options.table]
        print(table.to_csv(index=is_history(table)), end="")
        return
    folder = options.out
    console = Console(highlight=False)
    begin = time.perf_counter()
    tables = compute_tables(console)
    # Measured while no other job runs, for comparison with the CPU times of the paper.
    tables["table_2_times"] = table_2.measure_times()
    tables["rod_readings"] = figures_9_10.judge_readings(tables)
    tables["summary"] = summarize_claims(CLAIMS, tables)
    write_tables(tables, folder)
    draw_all(tables, folder / "figures.png")
    for _, claim in tables["summary"].iterrows():
        console.print(f"{claim['verdict']:>18}  {claim['claim']}", soft_wrap=True)
    console.print(f"written: {folder} in {time.perf_counter() - begin:.0f} s", soft_wrap=True)


if __name__ == "__main__":
    main()
