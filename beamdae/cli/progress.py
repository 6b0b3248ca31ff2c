"""Progress displays: a bar on a terminal, otherwise one line every ten seconds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Any

import typer

from beamdae.cli.output import create_progress_console, is_quiet
from beamdae.errors import format_count, format_percent
from beamdae.integrators.limits import followed_vibration

if TYPE_CHECKING:
    from beamdae.results.frequency_response import ResponsePoint
    from beamdae.studies.tasks import StudyProgress

_BAR_WIDTH = 14  # columns
_LINE_INTERVAL = 10.0  # between progress lines without a terminal [s]
_LONG_TIME = 60.0  # remaining time [s] from which on a run that follows vibrations has advice

# Function of the fraction done, the progress as text, the remaining time [s], the name of the
# running task, and True for lines that are always printed without a terminal.
Show = Callable[..., None]


@contextmanager
def show_progress(done: str, label: str) -> Iterator[Show]:
    """Show a line that is updated in place or, without a terminal, a line every ten seconds.

    Yield a function of further lines. With --quiet, nothing is shown.
    """
    console = None if is_quiet() else create_progress_console()
    if console is None:
        last = monotonic()

        def echo(
            _: float, done: str, remaining: float | None, label: str, is_end: bool = False
        ) -> None:
            nonlocal last
            if (is_end or monotonic() - last >= _LINE_INTERVAL) and not is_quiet():
                typer.echo(f"{label}: {done}, {format_clock(remaining)} left", err=True)
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
    looks: dict[str, Any] = {"console": console, "expand": True, "transient": True}
    with Progress(*columns, **looks, redirect_stdout=False, redirect_stderr=False) as progress:
        task = progress.add_task("", total=1.0, numbers="", label="")

        def update(
            fraction: float, done: str, remaining: float | None, label: str, _: bool = False
        ) -> None:
            numbers = f"{done} {format_clock(remaining)} left"
            progress.update(task, completed=fraction, numbers=numbers, label=label)

        update(0.0, done, None, label)
        yield update


@contextmanager
def show_run_progress(t_end: float, task: str = "") -> Iterator[Callable[[str, float], None]]:
    """Show the progress of a run; yield a function of a label and the simulated time [s].

    The remaining time is estimated from the progress since the first step.
    """
    start: tuple[float, float] | None = None  # simulated time and clock time [s]
    with show_progress(f"0/{t_end:.3g} s", task or "starting") as show:

        def update(label: str, t: float) -> None:
            nonlocal start
            remaining = None
            # Computations before the first step, such as a pilot run, report the start time.
            if start is None or t <= start[0]:
                start = t, monotonic()
            else:
                remaining = (monotonic() - start[1]) * max(t_end - t, 0.0) / (t - start[0])
            is_long = followed_vibration.get() and (remaining or 0.0) > _LONG_TIME
            advice = "vibrations hardly decay: set damping=" if is_long else ""
            label = ", ".join(filter(None, [advice, task, label]))
            show(t / (t_end or 1.0), f"{t:.3g}/{t_end:.3g} s", remaining, label)

        yield update


@contextmanager
def show_curve_progress(
    parameter: str, unit: str, ends: tuple[float, float]
) -> Iterator[Callable[[ResponsePoint], None]]:
    """Show the progress of a response curve; yield a function of each of its points."""
    from beamdae.model_parameters import format_with_unit

    count, (first, last), start = 0, ends, monotonic()
    with show_progress("0 points", "first periodic motion") as show:

        def update(point: ResponsePoint) -> None:
            nonlocal count
            count += 1
            fraction = (point.parameter - first) / (last - first)
            elapsed = monotonic() - start
            remaining = elapsed * (1.0 / fraction - 1.0) if fraction > 0.0 else None
            value = format_with_unit(float(f"{point.parameter:.4g}"), unit)
            show(fraction, format_count(count, "point"), remaining, f"{parameter} = {value}")

        yield update


@contextmanager
def show_design_progress(most: int) -> Iterator[Callable[[int, float, float], None]]:
    """Show the progress of an optimization of at most this number of designs.

    Yield a function of the number of designs, the objective and the violation, as of `optimize`.
    """
    start = monotonic()
    with show_progress("0 designs", "first design") as show:

        def update(count: int, objective: float, violation: float) -> None:
            label = f"objective {objective:.5g}"
            if violation > 0.0:
                label += f", a limit exceeded by {format_percent(violation)}"
            done = f"{format_count(count, 'design')}, {(monotonic() - start) / count:.2g} s each"
            show(count / most, done, None, label)

        yield update


@contextmanager
def show_study_progress() -> Iterator[Callable[[StudyProgress], None]]:
    """Show the progress of a study; yield a function that takes a `StudyProgress`."""
    is_first = True
    with show_progress("0 runs", "starting") as show:

        def update(x: StudyProgress) -> None:
            nonlocal is_first
            counts = {"running": x.running, "failed": x.failed, "stored before": x.stored}
            texts = [f"{count} {kind}" for kind, count in counts.items() if count]
            label = ", ".join(filter(None, [*texts, x.last_label])) or "runs"
            is_end, is_first = is_first or x.done == x.total, False
            done = f"{x.done}/{x.total}"
            show(x.done / max(x.total, 1), done, x.remaining_time, label, is_end)

        yield update


def format_clock(seconds: float | None) -> str:
    """Format a duration [s] as minutes:seconds or, from one hour on, as hours:minutes:seconds.

    The text is "-:--" for an unknown duration.
    """
    if seconds is None or not math.isfinite(seconds):
        return "-:--"
    minutes, rest = divmod(max(round(seconds), 0), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
