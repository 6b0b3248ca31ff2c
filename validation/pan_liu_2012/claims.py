"""Claims of the paper, with criteria and verdicts."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

Tables = Mapping[str, pd.DataFrame]

# All tests meet the threshold of the claim.
AGREES = "agrees"
# The effect has the stated sign, but not in all tests or not as clearly.
AGREES_IN_DIRECTION = "agrees in direction"
# The effect has the stated sign, but the numbers differ by more than a factor of two.
DIFFERS_IN_SIZE = "differs in size"
DIFFERS = "differs"
UNDECIDED = "cannot be decided"
# A number that is lost in print was chosen to satisfy the claim; agreement is no evidence.
BY_CONSTRUCTION = "by construction"
VERDICTS = (AGREES, AGREES_IN_DIRECTION, DIFFERS_IN_SIZE, DIFFERS, UNDECIDED, BY_CONSTRUCTION)

# Thresholds of all claims: largest error of a converged result and smallest obvious difference,
# relative to the amplitude; margin within which a number is close to a threshold, relative to it.
CONVERGED_ERROR = 0.01
OBVIOUS_DIFFERENCE = 0.10
THRESHOLD_MARGIN = 0.05
CONVERGED_TEXT = f"error of {CONVERGED_ERROR:.0%} of the amplitude"
OBVIOUS_TEXT = f"obvious: largest difference over {OBVIOUS_DIFFERENCE:.0%} of the amplitude"
WIDER_TEXT = f"wider: range over {1.0 + THRESHOLD_MARGIN:g} times"


class Judgement(NamedTuple):
    """Our numbers as text, the verdict and its reason."""

    ours: str
    verdict: str
    why: str


class Claim(NamedTuple):
    """A claim of the paper, its place and numbers, the test and the function that judges it."""

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
    """Return a decorator that turns a function that judges a claim into the claim."""

    def make_claim(judge: Callable[[Tables], Judgement]) -> Claim:
        name = judge.__name__.replace("_", " ")
        return Claim(name, text, where, paper, tested, threshold, judge)

    return make_claim


def judge_condition(condition: object) -> str:
    """Return AGREES if the condition is true, otherwise DIFFERS."""
    return AGREES if condition else DIFFERS


def judge_errors(errors: Iterable[float], threshold: float) -> str:
    """Return the verdict on errors; the largest within the margin leaves it undecided."""
    largest = max(errors)
    if abs(largest / threshold - 1.0) <= THRESHOLD_MARGIN:
        return UNDECIDED
    return judge_condition(largest < threshold)


def judge_factors(factors: Iterable[float], published: Iterable[float]) -> str:
    """Return the verdict on factors of increase compared with the paper's."""
    pairs = list(zip(factors, published, strict=True))
    if not all(factor > 1.0 + THRESHOLD_MARGIN for factor, _ in pairs):
        return DIFFERS
    return (
        AGREES if all(0.5 <= factor / paper <= 2.0 for factor, paper in pairs) else DIFFERS_IN_SIZE
    )


def summarize_claims(claims: Iterable[Claim], tables: Tables) -> pd.DataFrame:
    """Return one row a claim."""
    rows = [{**claim._asdict(), **claim.judge(tables)._asdict()} for claim in claims]
    return pd.DataFrame(rows).drop(columns="judge")


class Axis(NamedTuple):
    """Ends of the vertical axis of a figure, and the spacing of its ticks."""

    start: float
    end: float
    tick: float

    @property
    def length(self) -> float:
        """Distance of the ends."""
        return self.end - self.start


FIGURE_5A = Axis(-1.6e-4, 0.4e-4, 0.4e-4)
FIGURE_5B = Axis(-0.5e-4, 0.1e-4, 0.1e-4)
FIGURE_5C = Axis(-6.0, 6.0, 2.0)
FIGURE_6 = Axis(-0.10, 0.10, 0.02)
FIGURE_7 = Axis(-0.10, 0.12, 0.02)
FIGURE_9 = Axis(-0.20, 0.20, 0.05)
FIGURE_10 = Axis(-1.5, 1.5, 0.5)

# Relative to the length of an axis: smallest visible difference, range that curves should cover.
VISIBLE = 0.02
COVERED = 0.65
VISIBLE_TEXT = f"visible: over {VISIBLE:.0%} of the length of the figure's axis"
FILLS_TEXT = f"within the axis, by {VISIBLE:.0%} of its length, and over at least {COVERED:g} of it"


def fits_axis(low: Any, high: Any, axis: Axis) -> Any:
    """Return whether curves from `low` to `high` suit an axis: inside it, and not too small."""
    margin = VISIBLE * axis.length
    inside = (low >= axis.start - margin) & (high <= axis.end + margin)
    return inside & (high - low >= COVERED * axis.length)


def axis_share_of_difference(one: Any, other: Any, axis: Axis) -> np.ndarray:
    """Return the difference of two curves relative to the length of their axis."""
    return np.abs(np.asarray(one) - np.asarray(other)) / axis.length
