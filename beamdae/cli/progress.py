"""Progress on standard error: a bar in a terminal, otherwise a line every ten seconds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

import typer

from beamdae.cli.output import create_progress_console, is_quiet
from beamdae.errors import format_count, format_percent
from beamdae.integrators.limits import followed_vibration

if TYPE_CHECKING:
    from beamdae.results.frequency_response import ResponsePoint
    from beamdae.studies.execution.study_progress import StudyProgress

_BAR_WIDTH = 14  # columns
_LINE_INTERVAL = 10.0  # between progress lines without a terminal [s]
_LONG_TIME = 60.0  # remaining time [s] from which on a run that follows vibrations has advice
# Smallest fraction of the range of a curve at which its remaining time is estimated: first steps
# are short.
_MIN_CURVE_FRACTION = 0.1


class ProgressLine(NamedTuple):
    """Progress of a run, an analysis or a study.

    Attributes
    ----------
    fraction
        Fraction done, 0 to 1.
    done
        Progress as text, such as "3/12".
    remaining
        Remaining time [s], or None if unknown.
    label
        Name of the running task.
    is_end
        True for the first and the last line, which are always printed without a terminal.
    """

    fraction: float
    done: str
    remaining: float | None
    label: str
    is_end: bool = False


@contextmanager
def show_progress(first: ProgressLine) -> Iterator[Callable[[ProgressLine], None]]:
    """Show a line that is updated in place or, without a terminal, a line every ten seconds.

    Yield a function of further lines. With --quiet, nothing is shown.
    """
    console = None if is_quiet() else create_progress_console()
    if console is None:
        last = monotonic()

        def echo(line: ProgressLine) -> None:
            nonlocal last
            is_due = line.is_end or monotonic() - last >= _LINE_INTERVAL
            if is_due and not is_quiet():
                text = f"{line.label}: {line.done}, {format_clock(line.remaining)} left"
                typer.echo(text, err=True)
                last = monotonic()

        yield echo
        return
    from rich.progress import BarColumn, Progress, TextColumn
    from rich.table import Column

    # The label has the width that the numbers leave.
    columns = (
        BarColumn(_BAR_WIDTH),
        TextColumn("{task.fields[numbers]}", table_column=Column(no_wrap=True)),
        TextColumn(
            "{task.fields[label]}",
            markup=False,
            table_column=Column(no_wrap=True, overflow="ellipsis", ratio=1),
        ),
    )
    with Progress(
        *columns,
        console=console,
        expand=True,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    ) as progress:
        task = progress.add_task("", total=1.0, numbers="", label="")

        def update(line: ProgressLine) -> None:
            numbers = f"{line.done} {format_clock(line.remaining)} left"
            progress.update(task, completed=line.fraction, numbers=numbers, label=line.label)

        update(first)
        yield update


@contextmanager
def show_run_progress(t_end: float, task: str = "") -> Iterator[Callable[[str, float], None]]:
    """Show the progress of a run; yield a function of a label and the simulated time [s].

    `task` is the name of the computation if it is not the simulation.
    """
    estimate = _time_run(t_end)
    with show_progress(ProgressLine(0.0, f"0/{t_end:.3g} s", None, task or "starting")) as show:

        def update(label: str, t: float) -> None:
            done, remaining = f"{t:.3g}/{t_end:.3g} s", estimate(t)
            is_long = followed_vibration.get() and (remaining or 0.0) > _LONG_TIME
            advice = "vibrations hardly decay: set damping=" if is_long else ""
            label = ", ".join(filter(None, [advice, task, label]))
            show(ProgressLine(t / (t_end or 1.0), done, remaining, label))

        yield update


@contextmanager
def show_curve_progress(
    parameter: str, unit: str, ends: tuple[float, float]
) -> Iterator[Callable[[ResponsePoint], None]]:
    """Show the progress of a response curve; yield a function of each of its points."""
    from beamdae.model_parameters import format_with_unit

    estimate, count, (first, last) = _time_run(1.0), 0, ends
    with show_progress(ProgressLine(0.0, "0 points", None, "first periodic motion")) as show:

        def update(point: ResponsePoint) -> None:
            nonlocal count
            count += 1
            fraction = (point.parameter - first) / (last - first)
            value = format_with_unit(float(f"{point.parameter:.4g}"), unit)
            remaining = estimate(fraction)
            if fraction < _MIN_CURVE_FRACTION:
                remaining = None
            done = format_count(count, "point")
            show(ProgressLine(fraction, done, remaining, f"{parameter} = {value}"))

        yield update


@contextmanager
def show_design_progress(most: int) -> Iterator[Callable[[int, float, float], None]]:
    """Show the progress of an optimization of at most this number of designs.

    Yield a function of the number of designs, the objective and the violation of the limits. The
    number of designs that a search needs, and hence the remaining time, is unknown.
    """
    start = monotonic()
    with show_progress(ProgressLine(0.0, "0 designs", None, "first design")) as show:

        def update(count: int, objective: float, violation: float) -> None:
            label = f"objective {objective:.5g}"
            if violation > 0.0:
                label += f", a limit exceeded by {format_percent(violation)}"
            done = f"{format_count(count, 'design')}, {(monotonic() - start) / count:.2g} s each"
            show(ProgressLine(count / most, done, None, label))

        yield update


@contextmanager
def show_study_progress() -> Iterator[Callable[[StudyProgress], None]]:
    """Show the progress of a study; yield a function that takes a `StudyProgress`."""
    is_first = True
    with show_progress(ProgressLine(0.0, "0 runs", None, "starting")) as show:

        def update(x: StudyProgress) -> None:
            counts = {"running": x.running, "failed": x.failed, "stored before": x.stored}
            texts = [f"{count} {kind}" for kind, count in counts.items() if count]
            label = ", ".join(filter(None, [*texts, x.last_label])) or "runs"
            nonlocal is_first
            is_end, is_first = is_first or x.done == x.total, False
            remaining, done = x.remaining_time if x.done < x.total else 0.0, f"{x.done}/{x.total}"
            show(ProgressLine(x.done / max(x.total, 1), done, remaining, label, is_end))

        yield update


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


def format_clock(seconds: float | None) -> str:
    """Format a duration [s] as minutes:seconds or, from one hour on, as hours:minutes:seconds.

    An unknown or infinite duration becomes "-:--".
    """
    if seconds is None or not math.isfinite(seconds):
        return "-:--"
    minutes, rest = divmod(max(round(seconds), 0), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
