"""What is under way, on standard error: a bar in a terminal, lines now and then elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING

import typer

from beamdae.cli.output import create_progress_console, is_quiet

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from beamdae.studies.execution.study_progress import StudyProgress

# Letters of a bar: more are of no use, and with fewer it says nothing.
_MAX_BAR_WIDTH, _MIN_BAR_WIDTH = 14, 3
# A label in fewer letters says nothing either.
_MIN_LABEL_WIDTH = 8
# Where there is no terminal a run says how far it is after so many seconds [s].
_LINE_INTERVAL = 10.0


@dataclass(frozen=True)
class ProgressLine:
    """How far something is.

    Attributes
    ----------
    share
        Done of all, 0 to 1.
    done
        The same in numbers, such as "3/12".
    left
        Seconds it still takes; None if that is not known.
    label
        What is under way.
    """

    share: float
    done: str
    left: float | None
    label: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """One line: numbers whole, a bar as wide as it can be, a label in the rest."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        from beamdae.report.terminal.responsive_table import shorten_to_cells

        width = options.max_width
        told = f"{self.done} {format_clock(self.left)}"
        longer = f"{told} left"
        told = (
            longer if len(longer) + 1 + _MIN_BAR_WIDTH <= width else shorten_to_cells(told, width)
        )
        bar = max(min(_MAX_BAR_WIDTH, width - len(told) - 1), 0)
        room = width - bar - len(told) - 2
        line = Table.grid(padding=(0, 1, 0, 0))
        cells: list[ProgressBar | Text] = [Text(told, no_wrap=True)]
        if bar >= _MIN_BAR_WIDTH:
            cells.insert(0, ProgressBar(1.0, min(max(self.share, 0.0), 1.0), width=bar))
        if room >= _MIN_LABEL_WIDTH:
            cells.append(Text(shorten_to_cells(self.label, room), no_wrap=True))
        line.add_row(*cells)
        yield line


@contextmanager
def show_run_progress(t_end: float, what: str = "") -> Iterator[Callable[[str, float], None]]:
    """How far a run is, by the time it has reached; `what` it is, if it is not the run itself."""
    course = _RemainingTime(t_end)
    with _live_display() as show:
        say = show or _RunLines()

        def reached(label: str, t: float) -> None:
            label = ", ".join(filter(None, [what, label]))
            say(ProgressLine(course.share(t), f"{t:.3g}/{t_end:.3g} s", course.left(t), label))

        if show:
            show(ProgressLine(0.0, f"0/{t_end:.3g} s", None, what or "starting"))
        yield reached


@contextmanager
def show_study_progress() -> Iterator[Callable[[StudyProgress], None]]:
    """How far a study is, by the runs done."""
    begin = monotonic()
    with _live_display() as show:
        if show is None:
            yield (lambda _: None) if is_quiet() else _StudyLines()
            return

        def progress(standing: StudyProgress) -> None:
            done = f"{standing.done}/{standing.total}"
            label = ", ".join(filter(None, [_format_counts(standing), standing.last]))
            share = standing.done / max(standing.total, 1)
            show(ProgressLine(share, done, estimate_remaining_time(standing, begin), label))

        yield progress


@contextmanager
def _live_display() -> Iterator[Callable[[ProgressLine], None] | None]:
    """What shows a line that changes; None where there is no terminal, or nothing to be said."""
    screen = None if is_quiet() else create_progress_console()
    if screen is None:
        yield None
        return
    from rich.live import Live

    with Live(
        console=screen,
        transient=True,
        refresh_per_second=10,
        redirect_stdout=False,
        redirect_stderr=False,
        vertical_overflow="crop",
    ) as live:
        yield live.update


class _RemainingTime:
    """The time a run still takes, from what it has taken since it left its start."""

    def __init__(self, t_end: float) -> None:
        self._end = t_end
        self._first: tuple[float, float] | None = None

    def share(self, t: float) -> float:
        return t / self._end if self._end > 0.0 else 1.0

    def left(self, t: float) -> float | None:
        """Seconds, once there is a rate to tell them from."""
        # What goes ahead of a run is at its start.
        if self._first is None or t <= self._first[0]:
            self._first = (t, monotonic())
            return None
        start, begin = self._first
        return (monotonic() - begin) * max(self._end - t, 0.0) / (t - start)


def _format_counts(standing: StudyProgress) -> str:
    """How many are under way, failed and found on disk, if any."""
    counts = {
        "running": standing.running,
        "failed": standing.failed,
        "kept from before": standing.kept,
    }
    return ", ".join(f"{number} {what}" for what, number in counts.items() if number)


def estimate_remaining_time(standing: StudyProgress, begin: float) -> float | None:
    """What the study says of the time it still takes, or what its runs have taken so far."""
    told = getattr(standing, "left", None)
    fresh, missing = standing.done - standing.kept, standing.total - standing.done
    if not missing:
        return 0.0
    if told is not None or not fresh:
        return told
    return (monotonic() - begin) / fresh * missing


def format_clock(seconds: float | None) -> str:
    """A time in minutes and seconds, and hours if there are any."""
    if seconds is None or not math.isfinite(seconds):
        return "-:--"
    minutes, rest = divmod(max(round(seconds), 0), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class _RunLines:
    """A line of a run now and then."""

    def __init__(self) -> None:
        self._last = monotonic()

    def __call__(self, now: ProgressLine) -> None:
        if monotonic() - self._last < _LINE_INTERVAL or is_quiet():
            return
        typer.echo(f"{now.label}: {now.done}, {format_clock(now.left)} left", err=True)
        self._last = monotonic()


class _StudyLines:
    """A line at every tenth of the runs."""

    def __init__(self) -> None:
        self._next = 0.0
        self._begin = monotonic()

    def __call__(self, standing: StudyProgress) -> None:
        if standing.done >= self._next or standing.done == standing.total:
            seconds = estimate_remaining_time(standing, self._begin)
            rest = f", about {seconds:.0f} s left" if seconds else ""
            typer.echo(
                f"{standing.done} of {standing.total} runs, {standing.running} running, "
                f"{standing.failed} failed, {standing.kept} kept from before{rest}",
                err=True,
            )
            self._next = standing.done + 0.1 * standing.total
