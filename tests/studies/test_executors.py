"""Studies and sweeps on executors: threads, and a Dask cluster, one of whose workers is killed."""

from __future__ import annotations

import os
import signal
import sys
from concurrent.futures import ThreadPoolExecutor

import pandas as pd
import pytest
from study_models import swing
from study_runs import SerialPool, run_study

import beamdae as bd
from beamdae.studies.execution.executors import create_executor


@pytest.fixture
def distributed():
    """Import Dask for the tests that need it; the import takes long."""
    return pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")


# Dask warns of deprecated functions of the installed Tornado.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


STUDY = bd.Study(
    "swings",
    tuple(
        bd.Case(swing, {"mass": mass}, bd.GeneralizedAlpha(step=h))
        for mass in (1.0, 2.0, 3.0)
        for h in (2e-3, 1e-3, 5e-4, 2e-4)
    ),
    references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=5e-4)),
)
# Columns that differ between runs and processes.
VARIABLE_COLUMNS = ["wall time [s]", "setup time [s]", "measuring time [s]", "peak memory [GB]"]


@pytest.mark.slow(reason="starts a scheduler and two workers")
def test_study_survives_a_killed_worker_and_has_the_serial_table(tmp_path, distributed):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        pids = [worker.process.pid for worker in cluster.workers.values()]

        def kill_one(progress):
            if progress.done == 4 and len(pids) == 2:
                os.kill(pids.pop(), signal.SIGKILL)

        results = run_study(STUDY, tmp_path / "dask", create_executor("study", "", None, address), kill_one)
        repeated = run_study(STUDY, tmp_path / "dask", create_executor("study", "", None, address))
        # The second run had no tasks, and its connection must be closed nevertheless.
        with pytest.raises(ValueError, match="No clients found"):
            distributed.Client.current()
        over = {"mass": [1.0, -1.0, 2.0]}
        outputs = {"rows": lambda run: len(run.t)}
        with pytest.warns(bd.BeamdaeWarning, match="1 of 3 runs did not reach the end time"):
            swept = bd.sweep(swing, over, outputs=outputs, scheduler=address)
    assert list(swept.table["rows"].fillna(0.0)) == [401.0, 0.0, 401.0]
    assert len(pids) == 1
    assert len(repeated.table) == len(STUDY.cases)
    serial = run_study(STUDY, tmp_path / "serial", SerialPool())
    assert set(results.table["status"]) == {"ok"}
    pd.testing.assert_frame_equal(
        results.table.drop(columns=VARIABLE_COLUMNS), serial.table.drop(columns=VARIABLE_COLUMNS)
    )


def test_sweeps_run_on_any_executor():
    over = {"mass": [1.0, -1.0, 2.0]}
    with (
        ThreadPoolExecutor(2) as executor,
        pytest.warns(bd.BeamdaeWarning, match="1 of 3 runs did not reach the end time"),
    ):
        swept = bd.sweep(swing, over, of="end", scheduler=executor)
        # The executor is left open.
        assert executor.submit(int, "3").result() == 3
    serial = bd.sweep(swing, {"mass": [1.0, 2.0]}, of="end").table
    columns = [name for name in serial if name.startswith("end")]
    pd.testing.assert_frame_equal(
        swept.table[columns].iloc[[0, 2]].reset_index(drop=True), serial[columns]
    )


class BrokenExecutor(ThreadPoolExecutor):
    """Executor that loses all tasks but the first one."""

    def submit(self, function, *arguments):
        if self._work_queue.qsize() or self._threads:
            return super().submit(int, "lost")
        return super().submit(function, *arguments)


def test_tasks_that_an_executor_loses_are_not_run(tmp_path):
    with BrokenExecutor(1) as executor, pytest.warns(bd.BeamdaeWarning):
        swept = bd.sweep(swing, {"mass": [1.0, 2.0]}, folder=tmp_path, scheduler=executor)
    assert sorted(swept.table["status"]) == ["not run", "ok"]
    assert list(bd.sweep(swing, {"mass": [1.0, 2.0]}, folder=tmp_path).table["status"]) == ["ok"] * 2


@pytest.mark.parametrize("address", ["host:8786", "tcp://10.0.0.1:8786", "tls://[fe80::1%eth0]:1"])
def test_message_without_dask(address, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(bd.BeamdaeError, match=r"^swing_sweep: scheduler .* requires Dask, which is"):
        bd.sweep(swing, {"mass": [1.0]}, scheduler=address)


def test_a_scheduler_is_an_address_or_an_executor():
    with pytest.raises(bd.BeamdaeError, match=r"scheduler must be the address .*, got 8786\.$"):
        bd.sweep(swing, {"mass": [1.0]}, scheduler=8786)


@pytest.mark.slow(reason="waits for an answer")
@pytest.mark.usefixtures("distributed")
def test_missing_scheduler_is_an_error(monkeypatch):
    monkeypatch.setattr("beamdae.studies.execution.executors._CONNECT_TIMEOUT", 0.2)
    with pytest.raises(bd.BeamdaeError, match=r"scheduler tcp://127\.0\.0\.1:9 does not answer"):
        bd.sweep(swing, {"mass": [1.0]}, scheduler="tcp://127.0.0.1:9")
