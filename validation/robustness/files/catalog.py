"""Catalog of hostile files, and the trial of a single file."""

from __future__ import annotations

import random
import time
import warnings
from dataclasses import dataclass

from beamdae.errors import BeamdaeError, BeamdaeWarning, KernelWarning
from robustness import judge
from robustness.files.kinds import KINDS
from robustness.isolation import ScratchFolder
from robustness.trial_class import TrialClass

FILE_COUNT = 2000
SAMPLE_SIZE = 80
FILE_TIME_LIMIT = 30.0  # s


@dataclass(frozen=True)
class FileRow:
    """Row of the table of hostile files; see `judge.TrialOutcome` for `ended`."""

    file: str
    kind: str
    change: str
    ended: str
    text: str = ""
    complaint: str = ""
    wall: float = 0.0


def list_files(count: int = FILE_COUNT) -> list[str]:
    """Return the names of files, "KIND: CHANGE: NUMBER", in proportion to the shares of kinds."""
    return [
        f"{kind}: {recipe.changes[k % len(recipe.changes)]}: {k}"
        for kind, recipe in KINDS.items()
        for k in range(round(count * recipe.share))
    ]


def try_file(name: str) -> FileRow:
    """Write, read and use a hostile file."""
    kind, change, _ = name.split(": ")
    begin = time.perf_counter()
    with ScratchFolder() as scratch, warnings.catch_warnings():
        # Warnings of NumPy would be printed on standard error.
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", BeamdaeWarning)
        warnings.simplefilter("ignore", KernelWarning)
        path = KINDS[kind].write(scratch.folder, change, random.Random(name))
        try:
            KINDS[kind].use(path)
            outcome = judge.TrialOutcome("ran")
        except BeamdaeError as error:
            outcome = judge.TrialOutcome("refused", str(error))
        except Exception as error:
            outcome = judge.outcome_of_exception(error)
    complaint = judge.find_complaint(outcome)
    if outcome.ended == "raised":
        complaint = outcome.text
    wall = round(time.perf_counter() - begin, 2)
    return FileRow(name, kind, change, outcome.ended, outcome.text, complaint, wall)


TRIALS = TrialClass(
    "files",
    collect=list_files,
    attempt=try_file,
    time_limit=FILE_TIME_LIMIT,
    quick_size=SAMPLE_SIZE,
)
