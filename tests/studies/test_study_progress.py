"""Progress of studies: counts of runs, and the estimate of the remaining time."""

import pytest
from study_models import swing
from study_runs import SerialPool, run_study

import beamdae as bd

REFERENCES = (bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3))


@pytest.mark.slow(reason="half a second")
def test_progress_reports_the_remaining_time(tmp_path):
    reports = []
    cases = tuple(bd.Case(swing, {}, x) for x in (bd.GeneralizedAlpha(5e-3), bd.Ida(rtol=1e-3)))
    study = bd.results.Study("progress", cases, references=REFERENCES)
    run_study(study, tmp_path, SerialPool(), reports.append)
    assert reports[0].remaining_time is None
    assert all(report.remaining_time >= 0.0 for report in reports[1:])
    assert reports[-1].remaining_time == 0.0
