"""Progress on standard error: a bar in a terminal, otherwise occasional lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING

import typer

from beamdae.cli.output import create_progress_console, is_quiet
from beamdae.errors import format_count, format_percent
from beamdae.integrators.limits import followed_vibration

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from beamdae.results.frequency_response import ResponsePoint
    from beamdae.studies.execution.study_progress import StudyProgress

# Widths in columns; a narrower bar or label is left out.
_MAX_BAR_WIDTH = 14
_MIN_BAR_WIDTH = 3
_MIN_LABEL_WIDTH = 8
# Interval between progress lines of a run without a terminal.
_LINE_INTERVAL = 10.0  # s
_LONG_TIME = 60.0  # remaining time [s] from which on a run that follows vibrations has advice
# Smallest fraction of the range of a curve at which its remaining time is estimated: first steps
# are short.
_MIN_CURVE_FRACTION = 0.1
# Fraction of the runs of a study between progress lines without a terminal.
_LINE_FRACTION = 0.1


@dataclass(frozen=True)
class ProgressLine:
    """Progress of a run or a study.

    Attributes
    ----------
    fraction
        Fraction done, 0 to 1.
    done
        Progress as text, such as "3/12".
    remaining
        Remaining time [s], or None if unknown.
    label
        Name of the running task; for a study, counts of its runs and the label of the last run.
    """

    fraction: float
    done: str
    remaining: float | None
    label: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield one line with a bar, the numbers, and the label in the remaining width."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        from beamdae.report.terminal.responsive_table import shorten_to_cells

        width = options.max_width
        numbers = f"{self.done} {format_clock(self.remaining)}"
        if len(f"{numbers} left") + 1 + _MIN_BAR_WIDTH <= width:
            numbers = f"{numbers} left"
        else:
            numbers = shorten_to_cells(numbers, width)
        bar_width = max(min(_MAX_BAR_WIDTH, width - len(numbers) - 1), 0)
        label_width = width - bar_width - len(numbers) - 2
        line = Table.grid(padding=(0, 1, 0, 0))
        cells: list[ProgressBar | Text] = [Text(numbers, no_wrap=True)]
        if bar_width >= _MIN_BAR_WIDTH:
            fraction = min(max(self.fraction, 0.0), 1.0)
            cells.insert(0, ProgressBar(1.0, fraction, width=bar_width))
        if label_width >= _MIN_LABEL_WIDTH:
            cells.append(Text(shorten_to_cells(self.label, label_width), no_wrap=True))
        line.add_row(*cells)
        yield line


@contextmanager
def show_run_progress(t_end: float, task: str = "") -> Iterator[Callable[[str, float], None]]:
    """Show the progress of a run; yield a function of a label and the simulated time [s].

    `task` is the name of the computation if it is not the simulation.
    """
    estimate = _time_run(t_end)
    with _live_display() as show:
        show_line = show or _RunLines()

        def update(label: str, t: float) -> None:
            done, remaining = f"{t:.3g}/{t_end:.3g} s", estimate(t)
            advice = ""
            if followed_vibration.get() and (remaining or 0.0) > _LONG_TIME:
                advice = "vibrations hardly decay: set damping="
            label = ", ".join(filter(None, [advice, task, label]))
            show_line(ProgressLine(t / (t_end or 1.0), done, remaining, label))

        if show:
            show(ProgressLine(0.0, f"0/{t_end:.3g} s", None, task or "starting"))
        yield update


@contextmanager
def show_curve_progress(
    parameter: str, unit: str, ends: tuple[float, float]
) -> Iterator[Callable[[ResponsePoint], None]]:
    """Show the progress of a response curve; yield a function of each of its points."""
    from beamdae.model_parameters import format_with_unit

    estimate, count, (first, last) = _time_run(1.0), 0, ends
    with _live_display() as show:
        show_line = show or _RunLines()

        def update(point: ResponsePoint) -> None:
            nonlocal count
            count += 1
            fraction = (point.parameter - first) / (last - first)
            value = format_with_unit(float(f"{point.parameter:.4g}"), unit)
            done = format_count(count, "point")
            remaining = estimate(fraction)
            if fraction < _MIN_CURVE_FRACTION:
                remaining = None
            show_line(ProgressLine(fraction, done, remaining, f"{parameter} = {value}"))

        if show:
            show(ProgressLine(0.0, "0 points", None, "first periodic motion"))
        yield update


@contextmanager
def show_design_progress(most: int) -> Iterator[Callable[[int, float, float], None]]:
    """Show the progress of an optimization of at most this number of designs.

    Yield a function of the number of designs, the objective and the violation of the limits. The
    number of designs that a search needs, and hence the remaining time, is unknown.
    """
    start = monotonic()
    with _live_display() as show:
        show_line = show or _RunLines()

        def update(count: int, objective: float, violation: float) -> None:
            label = f"objective {objective:.5g}"
            if violation > 0.0:
                label += f", a limit exceeded by {format_percent(violation)}"
            done = f"{format_count(count, 'design')}, {(monotonic() - start) / count:.2g} s each"
            show_line(ProgressLine(count / most, done, None, label))

        if show:
            show(ProgressLine(0.0, "0 designs", None, "first design"))
        yield update


@contextmanager
def show_study_progress() -> Iterator[Callable[[StudyProgress], None]]:
    """Show the progress of a study; yield a function that takes a `StudyProgress`."""
    with _live_display() as show:
        if show is None:
            yield (lambda _: None) if is_quiet() else _StudyLines()
            return

        def update(progress: StudyProgress) -> None:
            done = f"{progress.done}/{progress.total}"
            label = ", ".join(filter(None, [_format_counts(progress), progress.last_label]))
            fraction = progress.done / max(progress.total, 1)
            show(ProgressLine(fraction, done, progress.remaining_time, label))

        yield update


@contextmanager
def _live_display() -> Iterator[Callable[[ProgressLine], None] | None]:
    """Yield a function that updates a line in place, or None without a terminal or with --quiet."""
    console = None if is_quiet() else create_progress_console()
    if console is None:
        yield None
        return
    from rich.live import Live

    with Live(
        console=console,
        transient=True,
        refresh_per_second=10,
        redirect_stdout=False,
        redirect_stderr=False,
        vertical_overflow="crop",
    ) as live:
        yield live.update


def _time_run(t_end: float) -> Callable[[float], float | None]:
    """Return a function of the simulated time [s] that estimates the remaining time [s].

    It extrapolates the mean speed since the start time, and returns None before the first step.
    """
    start: tuple[float, float] | None = None  # simulated time and clock time [s]

    def estimate(t: float) -> float | None:
        nonlocal start
        # Computations before the first step, such as a pilot run, report the start time.
        if start is None or t <= start[0]:
            start = t, monotonic()
            return None
        return (monotonic() - start[1]) * max(t_end - t, 0.0) / (t - start[0])

    return estimate


def _format_counts(progress: StudyProgress) -> str:
    counts = {
        "running": progress.running,
        "failed": progress.failed,
        "stored before": progress.stored,
    }
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count)


def format_clock(seconds: float | None) -> str:
    """Format a duration [s] as minutes:seconds or, from one hour on, as hours:minutes:seconds.

    An unknown or infinite duration becomes "-:--".
    """
    if seconds is None or not math.isfinite(seconds):
        return "-:--"
    minutes, rest = divmod(max(round(seconds), 0), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class _RunLines:
    """Prints the progress of a run at most every ten seconds; nothing with --quiet."""

    def __init__(self) -> None:
        self._last = monotonic()

    def __call__(self, line: ProgressLine) -> None:
        if monotonic() - self._last < _LINE_INTERVAL or is_quiet():
            return
        typer.echo(f"{line.label}: {line.done}, {format_clock(line.remaining)} left", err=True)
        self._last = monotonic()


class _StudyLines:
    """Prints the progress of a study at its start and end, and after each tenth of the runs."""

    def __init__(self) -> None:
        self._next = 0.0

    def __call__(self, progress: StudyProgress) -> None:
        if progress.done >= self._next or progress.done == progress.total:
            seconds = progress.remaining_time
            rest = f", about {seconds:.0f} s left" if seconds else ""
            typer.echo(
                f"{progress.done} of {progress.total} runs, {progress.running} running, "
                f"{progress.failed} failed, {progress.stored} stored before{rest}",
                err=True,
            )
            self._next = progress.done + _LINE_FRACTION * progress.total
