"""Warnings about errors of columns that an estimate of errors may exclude."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

_NEGLIGIBLE_ERROR = 0.01  # relative to half the range; the warnings speak of several percent


class SuspectedError(NamedTuple):
    """Warning about the time integration of columns.

    Attributes
    ----------
    sentence
        The warning.
    columns
        Headers of the columns.
    settings
        Settings of the integrator that are sufficient; empty if another integrator is recommended.
    """

    sentence: str
    columns: tuple[str, ...]
    settings: Mapping[str, float] = {}


def refuted_warnings(
    suspected: Iterable[SuspectedError], columns: Iterable[str], errors: Iterable[float]
) -> frozenset[str]:
    """Return the sentences of suspected errors whose columns all have estimates below 1 %.

    Parameters
    ----------
    suspected
        Suspected errors of a run.
    columns
        Headers of the observed columns.
    errors
        Estimated errors of these columns, relative to half the range.
    """
    pairs = zip(columns, errors, strict=True)
    accurate = {column for column, error in pairs if error < _NEGLIGIBLE_ERROR}
    return frozenset(x.sentence for x in suspected if accurate.issuperset(x.columns))
