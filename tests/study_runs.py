"""Runs of studies in this process, in other processes and on a cluster, which commands start."""

from beamdae.cli.model_file import ModelFile
from beamdae.errors import KernelWarning
from beamdae.results.outcome import Status
from beamdae.studies.case_table import summarize_cases
from beamdae.studies.executors import (
    LocalPool,
    SerialPool,
    create_executor,
)
from beamdae.studies.study_page import create_study_page
from beamdae.studies.study_run import run_study
from beamdae.studies.tasks import Outcome

__all__ = [
    "KernelWarning",
    "LocalPool",
    "LosingPool",
    "ModelFile",
    "SerialPool",
    "create_executor",
    "create_study_page",
    "run_serially",
    "run_study",
    "summarize_cases",
]


def run_serially(monkeypatch):
    """Let commands run studies without worker processes; their outputs do not depend on them."""
    executor = "beamdae.studies.executors.LocalPool"
    monkeypatch.setattr(executor, lambda workers: SerialPool())


class LosingPool(SerialPool):
    """Executor that loses all tasks but the first one."""

    def run_tasks(self, tasks):
        yield from super().run_tasks(tasks[:1])
        for task in tasks[1:]:
            status = Status("not run", "connection-lost.\nClient lost")
            yield task, Outcome(status, is_final=False)
