"""Studies and sweeps on other executors, and on a Dask cluster, one of whose workers is killed."""

import os
import signal
import sys
from concurrent.futures import Executor, Future

import pandas as pd
import pytest
from study_models import swing
from study_runs import SerialPool, create_executor, run_study

import beamdae as bd


@pytest.fixture
def distributed():
    """Import Dask for the tests that need it; the import takes long."""
    return pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")


# Dask warns of deprecated functions of the installed Tornado.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


STUDY = bd.results.Study(
    "swings",
    tuple(
        bd.Case(swing, {"mass": mass}, bd.GeneralizedAlpha(step=h))
        for mass in (1.0, 2.0, 3.0)
        for h in (2e-3, 1e-3, 5e-4, 2e-4)
    ),
    references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=5e-4)),
)
# Columns that differ between runs and processes.
VARIABLE_COLUMNS = ["wall time [s]", "setup time [s]", "measuring time [s]"]


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

        results = run_study(
            STUDY, tmp_path / "dask", create_executor("study", "", None, address), kill_one
        )
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


class InlineExecutor(Executor):
    """Executor that runs tasks at once, and loses those after the first `reliable` ones."""

    def __init__(self, reliable):
        self.reliable = reliable

    def submit(self, function, *arguments):
        future = Future()
        self.reliable -= 1
        if self.reliable >= 0:
            future.set_result(function(*arguments))
        else:
            future.set_exception(OSError("the node is lost"))
        return future


def test_sweeps_run_on_any_executor(tmp_path):
    over = {"mass": [1.0, -1.0, 2.0]}
    with pytest.warns(bd.BeamdaeWarning, match="1 of 3 runs did not reach the end time"):
        swept = bd.sweep(swing, over, folder=tmp_path, scheduler=InlineExecutor(3))
    with pytest.warns(bd.BeamdaeWarning):
        serial = bd.sweep(swing, over)
    columns = [name for name in serial.table if name.endswith(("[m]", "[N]"))]
    pd.testing.assert_frame_equal(swept.table[columns], serial.table[columns])


def test_tasks_that_an_executor_loses_are_run_again(tmp_path):
    over = {"mass": [1.0, 2.0]}
    with pytest.warns(bd.BeamdaeWarning, match="the executor failed: OSError: the node is lost"):
        swept = bd.sweep(swing, over, folder=tmp_path, scheduler=InlineExecutor(1))
    assert list(swept.table["status"]) == ["ok", "not run"]
    again = bd.sweep(swing, over, folder=tmp_path)
    assert list(again.table["status"]) == ["ok", "ok"]


@pytest.mark.parametrize("address", ["host:8786", "tcp://10.0.0.1:8786", "tls://[fe80::1%eth0]:1"])
def test_message_without_dask(address, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(bd.BeamdaeError, match=r"^swing_sweep: scheduler .* requires Dask, "):
        bd.sweep(swing, {"mass": [1.0]}, scheduler=address)


def test_a_scheduler_is_an_address_or_an_executor():
    with pytest.raises(bd.BeamdaeError, match=r"scheduler must be the address .*, got 8786\.$"):
        bd.sweep(swing, {"mass": [1.0]}, scheduler=8786)


@pytest.mark.slow(reason="waits for an answer")
@pytest.mark.usefixtures("distributed")
def test_missing_scheduler_is_an_error(monkeypatch):
    monkeypatch.setattr("beamdae.studies.executors._CONNECT_TIMEOUT", 0.2)
    with pytest.raises(bd.BeamdaeError, match=r"scheduler tcp://127\.0\.0\.1:9 does not answer"):
        bd.sweep(swing, {"mass": [1.0]}, scheduler="tcp://127.0.0.1:9")
