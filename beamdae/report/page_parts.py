"""Parts that pages of analyses share: one group, a case for each row of a table, columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.report.page.page_content import Content
from beamdae.report.terminal.text_tables import table_of
from beamdae.results.columns import Header
from beamdae.results.storage.files import versions

if TYPE_CHECKING:
    import pandas as pd

    from beamdae.report.descriptions import Description

GROUP = "all"  # id of the only group of cases
_NUMBERS = "iuf"  # kinds of NumPy's types of numbers


def describe_page(
    title: str,
    subtitle: str,
    warnings: Sequence[str],
    tables: Sequence[Content] = (),
    **entries: Any,
) -> Content:
    """Return a page with one group, without tables that have no rows."""
    return {
        "title": title,
        "subtitle": subtitle,
        "made": versions(),
        "notes": list(warnings),
        "groups": [{"id": GROUP}],
        "tables": [table for table in tables if table["rows"]],
        **entries,
    }


def describe_columns(
    label: str, table: pd.DataFrame, units: Mapping[str, str] | None = None
) -> list[Content]:
    """Return the columns of the cases, whose label has the header `label`."""
    columns: list[Content] = [{"key": "label", "label": label, "unit": "", "kind": "text"}]
    for name in map(str, table):
        unit = (units or {}).get(name, Header.of(name).unit)
        kind = "number" if table[name].dtype.kind in _NUMBERS else "text"
        header = name.removesuffix(f" [{unit}]")
        columns.append({"key": name, "label": header, "unit": unit, "kind": kind})
    return columns


def create_cases(
    table: pd.DataFrame, labels: Sequence[str], *entries: Mapping[str, Any], **common: Any
) -> list[Content]:
    """Return a case for each row of a table, with further entries of each or common to all."""
    rows = table.replace({np.nan: None}).to_dict("records")
    further: Sequence[Mapping[str, Any]] = entries or [{}] * len(rows)
    return [
        {"id": str(k), "group": GROUP, "label": label, "rank": k, "values": row, **common, **entry}
        for k, (label, row, entry) in enumerate(zip(labels, rows, further, strict=True))
    ]


def fact_table(title: str, facts: Mapping[str, Any], section: str = "results") -> Content:
    """Return a table of facts by topic, without those that have no text."""
    texts = {
        topic: ", ".join(map(str, x)) if isinstance(x, (list, tuple)) else x
        for topic, x in facts.items()
    }
    rows = [[topic, str(text)] for topic, text in texts.items() if text not in ("", None)]
    return {"title": title, "rows": rows, "section": section}


def export_table(title: str, rows: Any) -> Content:
    """Return a data frame, or rows by header, as a table of the page."""
    if not len(rows):
        return {"title": title, "head": [], "rows": [], "section": "results"}
    head, *texts = table_of(rows).texts
    return {"title": title, "head": head, "rows": texts, "section": "results"}


def export_tables(description: Description) -> list[Content]:
    """Return the tables of a description as tables of the page."""
    return [export_table(title, table) for title, table in description.tables.items()]


def slider(label: str, values: Sequence[Any], unit: str = "") -> dict[str, Any]:
    """Return a slider of a page."""
    return {"label": label, "unit": unit, "values": list(values)}
