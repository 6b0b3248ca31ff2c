"""`beamdae compare`: run a study, or one model with several integrators."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from beamdae.cli.option_values import parse_assignments
from beamdae.cli.options import ComparedColumns
from beamdae.cli.results import Report
from beamdae.cli.study_outputs import StudyJob, StudyReport, results_folder_name
from beamdae.errors import BeamdaeError

# NumPy and CasADi are imported inside functions, so that --help responds quickly.
if TYPE_CHECKING:
    from beamdae.studies.definition import Study
    from beamdae.studies.study_run import StudyResults


def compare_command(job: StudyJob, compared: ComparedColumns = None) -> None:
    """Run a study, or one model with several integrators, and compare with a reference.

    Finished cases are stored in the results folder: run the same command again to resume. Exits
    with 0 on success, 1 if all cases failed or a reference or output file is missing, 2 for a usage
    or model error, 3 if processes or a cluster failed before all cases were run, 130 after Ctrl-C,
    and 143 after SIGTERM.
    """
    study = _select_study(job.path, job.model_name, parse_assignments(job.settings))
    job.run(study, compared, _create_report)


def _create_report(results: StudyResults) -> StudyReport:
    from beamdae.report import tables
    from beamdae.report.descriptions import Description
    from beamdae.report.text import make_printable
    from beamdae.studies.study_page import list_plots

    def write_page(path: Path) -> Path:
        from beamdae.report.page.page_file import write_page as write
        from beamdae.studies.study_page import create_study_page

        return write(path, create_study_page(results))

    table, groups = results.table, list(results.references)
    ungrouped = [results.study.cases[row] for row in table.index[~table["group"].isin(groups)]]
    shown: dict[str, Any] = {}
    if ungrouped:
        shown["completion"] = results.describe_completion(ungrouped)
    for group in groups:
        reference = results.references[group].sentence
        shown[f"reference {group}"] = make_printable(f"{group}: {reference}")
        shown[f"cases {group}"] = tables.comparison_table(table[table["group"] == group])
    failures = [f"{k}: {x.sentence}" for k, x in results.references.items() if x.table is None]
    data = {
        "study": results.study.name,
        "folder": results.folder,
        "interrupted": results.interrupted,
        "references": {group: x.sentence for group, x in results.references.items()},
        "cases": table,
        "summary": results.summary,
    }
    return StudyReport(
        results,
        Report(
            results.study.name,
            Description({}, shown, lambda: data),
            warnings=results.describe_warnings(),
            source="cases.csv",
            failures=[] if results.interrupted else failures,
        ),
        [results.folder / name for name in results.tables],
        write_page,
        list_plots(results),
    )


def _select_study(path: Path, name: str | None, settings: dict[str, str]) -> Study:
    """Return a study of the file, or a study of one of its models with the default integrators."""
    from beamdae.cli.model_file import ModelFile, select_by_name
    from beamdae.studies.case import Case, default_integrators
    from beamdae.studies.definition import Study
    from beamdae.studies.sweeps.sweep import Sweep

    file = ModelFile(path)
    sweeps = [key for key, study in file.studies.items() if isinstance(study, Sweep)]
    studies = {key: study for key, study in file.studies.items() if key not in sweeps}
    if name in sweeps or (name is None and sweeps and not studies):
        raise BeamdaeError(f"{path}: {name or sweeps[0]} is a sweep; use beamdae sweep.")
    if studies and (name in studies or name not in file.models):
        study = select_by_name(path, "study", studies, name)
        if settings:
            raise BeamdaeError(
                f"--set {next(iter(settings))}: a study defines all parameters; omit --set."
            )
        return study
    model = file.model(name)
    values = {key: model.complete({key: value})[key] for key, value in settings.items()}
    cases = tuple(Case(model, values, integrator) for integrator in default_integrators())
    return Study(results_folder_name(f"{model.name}_compare", values), cases)
