"""What the paper claims beside what was found here: one row a claim, with a verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import pandas as pd

Tables = Mapping[str, pd.DataFrame]

# What the paper says, by the threshold of the row, in all that was tested.
AGREES = "agrees"
# More, less or wider as the paper says, but not in all that was tested or not as clearly.
IN_DIRECTION = "agrees in direction"
# More or less as the paper says, its number missed by more than a factor of two.
IN_SIZE = "differs in size"
DIFFERS = "differs"
OPEN = "cannot be decided"
# A number the print has lost was chosen so that this holds: no evidence for the paper.
BY_CONSTRUCTION = "by construction"
VERDICTS = (AGREES, IN_DIRECTION, IN_SIZE, DIFFERS, OPEN, BY_CONSTRUCTION)

# Thresholds, the same for all claims: an error that counts as converged and a difference that is
# obvious, both of the amplitude; the share of a threshold within which a number is marked.
CONVERGED, OBVIOUS, NEAR = 0.01, 0.10, 0.05
CONVERGED_TEXT = f"error of {CONVERGED:.0%} of the amplitude"
OBVIOUS_TEXT = f"obvious: largest difference over {OBVIOUS:.0%} of the amplitude"
WIDER_TEXT = f"wider: range over {1.0 + NEAR:g} times"


class Judgement(NamedTuple):
    """Our numbers in words, the verdict and its reason."""

    ours: str
    verdict: str
    why: str


class Claim(NamedTuple):
    """A claim of the paper, where it stands, its numbers; what is tested, and how it is judged."""

    name: str
    claim: str
    where: str
    paper: str
    tested: str
    threshold: str
    judge: Callable[[Tables], Judgement]


def claim(
    text: str, where: str, paper: str, tested: str, threshold: str
) -> Callable[[Callable[[Tables], Judgement]], Claim]:
    """Make a claim of the function that judges it."""

    def of(judge: Callable[[Tables], Judgement]) -> Claim:
        name = judge.__name__.replace("_", " ")
        return Claim(name, text, where, paper, tested, threshold, judge)

    return of


def agrees(condition: object) -> str:
    """The verdict on a condition."""
    return AGREES if condition else DIFFERS


def within(errors: Iterable[float], threshold: float) -> str:
    """The verdict on errors: none may be beyond; those at the threshold leave it undecided."""
    largest = max(errors)
    if abs(largest / threshold - 1.0) <= NEAR:
        return OPEN
    return agrees(largest < threshold)


def sized(found: Iterable[float], published: Iterable[float]) -> str:
    """The verdict on factors by which something is more, beside the paper's."""
    pairs = list(zip(found, published, strict=True))
    if not all(factor > 1.0 + NEAR for factor, _ in pairs):
        return DIFFERS
    return AGREES if all(0.5 <= factor / paper <= 2.0 for factor, paper in pairs) else IN_SIZE


def summary(claims: Iterable[Claim], tables: Tables) -> pd.DataFrame:
    """One row a claim."""
    rows = [{**claim._asdict(), **claim.judge(tables)._asdict()} for claim in claims]
    return pd.DataFrame(rows).drop(columns="judge")
