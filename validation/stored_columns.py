"""Tables with different columns in one JSON file."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def write_columns(
    file: Path, tables: Mapping[str, Mapping[str, Sequence[Any]]], digits: int
) -> None:
    """Write the columns of tables, one a line; floats have the given number of digits."""

    def as_text(value: Any) -> str:
        if not isinstance(value, float):
            return json.dumps(value)
        return "null" if math.isnan(value) else f"{value:.{digits}g}"

    texts = []
    for name, table in tables.items():
        columns = (f"  {json.dumps(x)}: [{','.join(map(as_text, y))}]" for x, y in table.items())
        texts.append(f" {json.dumps(name)}: {{\n" + ",\n".join(columns) + "\n }")
    file.write_text("{\n" + ",\n".join(texts) + "\n}\n", "utf-8")
