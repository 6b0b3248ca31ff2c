"""What the paper claims beside what was found here: one row a claim, with a verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import pandas as pd

Tables = Mapping[str, pd.DataFrame]
OPEN = "cannot be decided"
# A number the print has lost was chosen so that this holds: no evidence for the paper.
BY_CONSTRUCTION = "by construction"


class Judgement(NamedTuple):
    """Our numbers in words, the verdict and its reason."""

    ours: str
    verdict: str
    why: str


class Claim(NamedTuple):
    """A claim of the paper, where it stands, its numbers, and how it is judged."""

    name: str
    claim: str
    where: str
    paper: str
    judge: Callable[[Tables], Judgement]


def claim(text: str, where: str, paper: str) -> Callable[[Callable[[Tables], Judgement]], Claim]:
    """Make a claim of the function that judges it."""

    def of(judge: Callable[[Tables], Judgement]) -> Claim:
        return Claim(judge.__name__.replace("_", " "), text, where, paper, judge)

    return of


def agrees(condition: object) -> str:
    """The verdict on a condition."""
    return "agrees" if condition else "differs"


def summary(claims: Iterable[Claim], tables: Tables) -> pd.DataFrame:
    """One row a claim."""
    rows = [{**claim._asdict(), **claim.judge(tables)._asdict()} for claim in claims]
    return pd.DataFrame(rows).drop(columns="judge")
