"""Where tables go."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

RESULTS = Path(__file__).parent / "results"


def write(folder: Path, name: str, table: pd.DataFrame) -> None:
    """Print a table, and store it."""
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / f"{name}.csv", index=False, float_format="%.4g")
    text = table.to_string(index=False, na_rep="", float_format=lambda x: f"{x:.3g}")
    print(text, end="\n\n", flush=True)
