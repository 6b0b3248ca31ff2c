"""All runs of a study: its cases and their references, each once."""

from __future__ import annotations

from dataclasses import dataclass, replace

from beamdae.studies.case import DigestCache
from beamdae.studies.definition import Study
from beamdae.studies.execution.case_run import Task
from beamdae.studies.references import create_reference_tasks, group_cases
from beamdae.studies.unique_names import create_file_names


@dataclass(frozen=True)
class Plan:
    """All runs of a study, with fingerprints that were taken once.

    Attributes
    ----------
    of_cases
        The task of each case, by its identity.
    group_of
        The group of each case, likewise.
    methods
        The tasks of the two methods of the reference of each group in which errors are asked for.
    tasks
        Each run once.
    """

    study: Study
    of_cases: dict[int, Task]
    group_of: dict[int, str]
    methods: dict[str, list[list[Task]]]
    tasks: list[Task]

    @classmethod
    def of(cls, study: Study) -> Plan:
        """The plan of a study as its models are now."""
        known: DigestCache = {}
        of_cases = {id(case): study.task(case, known=known) for case in study.cases}
        found = group_cases(study, of_cases, known)
        methods = {
            group: create_reference_tasks(study, cases, known)
            for group, cases in found.items()
            if study.measures(len({of_cases[id(case)].key for case in cases}))
        }
        of_references = [task for group in methods.values() for m in group for task in m]
        group_of = {id(case): group for group, cases in found.items() for case in cases}
        return cls(
            study, of_cases, group_of, methods, _unique([*of_references, *of_cases.values()])
        )


def _unique(tasks: list[Task]) -> list[Task]:
    """Each run once, with all that any of those who want it ask for, and a name of its own."""
    found: dict[str, Task] = {}
    for task in tasks:
        earlier = found.setdefault(task.key, task)
        found[task.key] = replace(
            earlier,
            repetitions=max(earlier.repetitions, task.repetitions),
            animated=earlier.animated or task.animated,
        )
    names = create_file_names((task.case.group, task.case.label) for task in found.values())
    return [replace(x, name=name) for x, name in zip(found.values(), names, strict=True)]
