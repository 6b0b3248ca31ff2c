"""Bars of what is under way, on standard error: how far it is, and how long it still takes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from beamdae.cli.saying import progress_console
from beamdae.report.letters import plain

if TYPE_CHECKING:
    from beamdae.studies.engine import Standing

_BAR = 14


@contextmanager
def run_progress(t_end: float) -> Iterator[Callable[[str, float], None]]:
    """A bar of the time reached, if there is a terminal."""
    from rich.progress import TimeElapsedColumn

    with _bar(TimeElapsedColumn()) as update:
        yield lambda label, t: update(t, t_end, f"t = {t:.3g} of {t_end:.3g} s", label)


@contextmanager
def study_progress() -> Iterator[Callable[[Standing], None]]:
    """A bar of the runs done; lines now and then where there is no terminal."""
    if progress_console() is None:
        yield _Lines()
        return
    begin = time.perf_counter()
    with _bar() as update:

        def progress(standing: Standing) -> None:
            left = _clock(_seconds_left(standing, begin))
            done = f"{standing.done}/{standing.total} {left}"
            label = ", ".join(filter(None, [_counts(standing), standing.last]))
            update(standing.done, standing.total, done, label)

        yield progress


@contextmanager
def _bar(*further: Any) -> Iterator[Callable[[float, float, str, str], None]]:
    """A bar, what is done, further columns, and a label in the room that is left."""
    screen = progress_console()
    if screen is None:
        yield lambda *_: None
        return
    from rich.progress import BarColumn, Progress, TextColumn
    from rich.table import Column

    rest = Column(ratio=1, no_wrap=True, overflow="ellipsis")
    columns = (
        BarColumn(_BAR),
        TextColumn("{task.fields[done]}", markup=False, table_column=Column(no_wrap=True)),
        *further,
        TextColumn("{task.fields[label]}", markup=False, table_column=rest),
    )
    with Progress(
        *columns,
        console=screen,
        transient=True,
        expand=True,
        redirect_stdout=False,
        redirect_stderr=False,
    ) as bar:
        task = bar.add_task("", total=None, done="", label="")

        def update(completed: float, total: float, done: str, label: str) -> None:
            bar.update(task, completed=completed, total=total, done=done, label=plain(label))

        yield update


def _counts(standing: Standing) -> str:
    """How many are under way, failed and found on disk, if any."""
    counts = {
        "running": standing.running,
        "failed": standing.failed,
        "kept from before": standing.kept,
    }
    return ", ".join(f"{number} {what}" for what, number in counts.items() if number)


def _seconds_left(standing: Standing, begin: float) -> float | None:
    """What the study says of the time it still takes, or what its runs have taken so far."""
    told = getattr(standing, "left", None)
    fresh, missing = standing.done - standing.kept, standing.total - standing.done
    if not missing:
        return 0.0
    if told is not None or not fresh:
        return told
    return (time.perf_counter() - begin) / fresh * missing


def _clock(seconds: float | None) -> str:
    """The time left in hours, minutes and seconds."""
    if seconds is None or not math.isfinite(seconds):
        return "-:--:--"
    whole = max(round(seconds), 0)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d} left"


class _Lines:
    """A line at every tenth of the runs."""

    def __init__(self) -> None:
        self._next = 0.0
        self._begin = time.perf_counter()

    def __call__(self, standing: Standing) -> None:
        if standing.done >= self._next or standing.done == standing.total:
            seconds = _seconds_left(standing, self._begin)
            rest = f", about {seconds:.0f} s left" if seconds else ""
            typer.echo(
                f"{standing.done} of {standing.total} runs, {standing.running} running, "
                f"{standing.failed} failed, {standing.kept} kept from before{rest}",
                err=True,
            )
            self._next = standing.done + 0.1 * standing.total
