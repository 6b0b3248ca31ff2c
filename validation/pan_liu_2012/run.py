"""Regenerate every table and figure of Pan & Liu (2012).

    python validation/pan_liu_2012/run.py [--out results/pan_liu_2012]

Writes CSV and PNG; summary.csv has one row for each claim of the paper, with a verdict. Wall times
are in table_2_times.csv and in columns of their own.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[2] / "models"), str(Path(__file__).parents[1])]

import pandas as pd
from rich.console import Console

from pan_liu_2012 import (
    appendix_claims,
    curved_spin_up,
    dissipation,
    figure_5,
    figure_5_claims,
    figures_6_7,
    figures_9_10,
    figures_9_10_claims,
    manoeuvre,
    reach,
    readings,
    steps,
    table_1,
    table_2,
    table_2_claims,
)
from pan_liu_2012.claims import summary
from pan_liu_2012.pictures import draw_all

Tables = dict[str, pd.DataFrame]
Job = tuple[str, Callable[..., Tables], tuple[Any, ...]]
STUDIES = (
    table_2_claims,
    steps,
    figures_6_7,
    figure_5_claims,
    figures_9_10_claims,
    dissipation,
    curved_spin_up,
    appendix_claims,
)
CLAIMS = [claim for study in STUDIES for claim in study.CLAIMS]


def jobs() -> list[Job]:
    """Everything to run, the longest first: what it makes, function, arguments."""
    return [
        ("generalized-alpha", dissipation.tables, ()),
        *(
            (f"table 2, {name}, {beam[0]:g} degrees, {beam[1]}", table_2.errors, (name, *beam))
            for name in table_2.INTEGRATORS
            for beam in table_2.BEAMS
        ),
        ("damping", figure_5.damping, ()),
        ("figure 5", figure_5.histories, ()),
        *(("gauge scan", figure_5.scan, (name,)) for name in figure_5.ORIENTATIONS),
        *(("figures 9 and 10", figures_9_10.histories, (c,)) for c in figures_9_10.CRANKS),
        *(("curved spin-up", curved_spin_up.errors, (speed,)) for speed in curved_spin_up.SPEEDS),
        *(("steps", steps.errors, (name,)) for name in steps.SYSTEMS),
        *(("reach", reach.hub, (factor,)) for factor in reach.FACTORS),
        ("reach", reach.rod, ()),
        *(("readings", readings.hub, (name,)) for name in readings.HUB),
        *(("readings", readings.crank, (name,)) for name in readings.CRANK),
        *(("figures 6 and 7", figures_6_7.histories, (angle,)) for angle in (60.0, 30.0)),
        ("spin-up", manoeuvre.histories, ()),
        ("table 1", table_1.table, ()),
        ("appendix", appendix_claims.table, ()),
    ]


def computed(console: Console) -> Tables:
    """Tables by name, from one process a core; the pieces several jobs make are put together."""
    begin, wanted = time.perf_counter(), jobs()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(mp_context=context) as pool:
        futures = [pool.submit(function, *given) for _, function, given in wanted]
        names = dict(zip(futures, (name for name, _, _ in wanted), strict=True))
        for done, future in enumerate(as_completed(futures), start=1):
            future.result()
            elapsed = time.perf_counter() - begin
            console.print(f"{done:3d} of {len(wanted)}  {elapsed:4.0f} s  {names[future]}")
    pieces: dict[str, list[pd.DataFrame]] = {}
    for future in futures:
        for name, table in future.result().items():
            pieces.setdefault(name, []).append(table)
    return {name: joined(parts) for name, parts in pieces.items()}


def is_history(table: pd.DataFrame) -> bool:
    """Whether the rows are times."""
    return table.index.name == "t [s]"


def joined(parts: list[pd.DataFrame]) -> pd.DataFrame:
    """Histories side by side, other tables one above the other."""
    return pd.concat(parts, axis=1) if is_history(parts[0]) else pd.concat(parts, ignore_index=True)


def write(tables: Tables, folder: Path) -> None:
    """One CSV a table; time histories carry their time as the first column."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=is_history(table), float_format="%.8g")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/pan_liu_2012"))
    folder = parser.parse_args().out
    console = Console(highlight=False)
    begin = time.perf_counter()
    tables = computed(console)
    tables["table_2"] = table_2.table(tables["table_2_errors"])
    # Alone, for these are the times to lay beside the paper's.
    tables["table_2_times"] = table_2.times()
    tables["rod_readings"] = figures_9_10_claims.judged_readings(tables)
    tables["summary"] = summary(CLAIMS, tables)
    write(tables, folder)
    draw_all(tables, folder)
    for _, claim in tables["summary"].iterrows():
        console.print(f"{claim['verdict']:>18}  {claim['claim']}", soft_wrap=True)
    console.print(f"written: {folder} in {time.perf_counter() - begin:.0f} s", soft_wrap=True)


if __name__ == "__main__":
    main()
