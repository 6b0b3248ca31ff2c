"""What commands have done, as far as they got: files, and whether one of them failed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from beamdae.cli.output import complain
from beamdae.errors import BeamdaeError, format_exception


@dataclass
class Written:
    """Files that are there, in the order they were written in, and whether one failed."""

    paths: list[Path] = field(default_factory=list)
    failed: bool = False

    def draw(self, what: str, draw: Callable[[], list[Path]]) -> None:
        """Write pictures or a page; those that fail are told of, and cost nothing else."""
        try:
            self.paths += draw()
            return
        except BeamdaeError as problem:
            complain(f"failed: {problem}")
        except Exception as problem:  # Whatever a table holds that a picture has no answer to.
            complain(f"failed: {what}: it cannot be drawn, {format_exception(problem)}.")
        self.failed = True
