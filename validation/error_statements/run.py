"""Compare stated with true errors of all cases: `python validation/error_statements/run.py [TEXT]`.

Prints the summary, and writes results/statements.csv unless TEXT selects cases. With TEXT, the
columns and the warnings of each case are printed.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "models"), str(ROOT / "validation")]

import pandas as pd

from error_statements.cases import ALL, measure_errors
from error_statements.statements import compare, read_statement

TABLE = Path(__file__).parent / "results" / "statements.csv"


def summarize(table: pd.DataFrame) -> pd.DataFrame:
    """Return numbers of cases and columns by what is too coarse."""
    wrong = table[table["wrong"] > 0]
    groups = dict(list(table.groupby("kind", sort=False))) | {"all": table}
    rows = {}
    for kind, group in groups.items():
        above = wrong[wrong.index.isin(group.index)]
        rows[kind] = {
            "cases": len(group),
            "above 4 %": len(above),
            "detected": int((above["verdict"] != "missed").sum()),
            "size right": int((above["verdict"] == "right").sum()),
            "false": int((group["verdict"] == "false").sum()),
            "columns above 4 %": int(above["wrong"].sum()),
            "named": int(above["named"].sum()),
            "of these, size right": int(above["sized"].sum()),
        }
    return pd.DataFrame(rows).T


def main(text: str = "") -> None:
    rows = []
    for case in ALL:
        if text not in case.name:
            continue
        solution = case.run()
        statement = read_statement(solution)
        result = compare(case, solution, statement)
        rows.append({"case": case.name, "kind": case.kind, **result._asdict()})
        if text:
            errors = measure_errors(solution.observed, case.reference)
            stated = statement.peaks if case.kind == "rows" else statement.errors
            errors["stated"] = pd.Series(stated, dtype=float)
            print(f"{case.name}: {result}", errors.to_string(), *solution.warnings, sep="\n")
    table = pd.DataFrame(rows)
    if not text:
        table.to_csv(TABLE, index=False, float_format="%.3g")
    print(summarize(table).to_string())


if __name__ == "__main__":
    main(*sys.argv[1:])
