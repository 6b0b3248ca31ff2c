"""Runs of studies in this process, in other processes and on a cluster, which commands start."""

from beamdae.cli.model_files.model_file import ModelFile
from beamdae.studies.execution.executors import DaskPool, LocalPool, SerialPool
from beamdae.studies.execution.study_run import run_study
from beamdae.studies.study_page import create_study_page
from beamdae.studies.tasks import Limits

__all__ = [
    "DaskPool",
    "Limits",
    "LocalPool",
    "ModelFile",
    "SerialPool",
    "create_study_page",
    "run_serially",
    "run_study",
]


def run_serially(monkeypatch):
    """Let commands run studies without worker processes; their outputs do not depend on them."""
    executor = "beamdae.studies.execution.executors.LocalPool"
    monkeypatch.setattr(executor, lambda workers: SerialPool())
