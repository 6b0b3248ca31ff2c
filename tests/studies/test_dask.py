"""Studies and sweeps on a Dask cluster, one of whose workers is killed."""

from __future__ import annotations

import os
import signal
import sys

import pandas as pd
import pytest
from study_models import swing
from study_runs import DaskPool, SerialPool, run_study

import beamdae as bd


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

        results = run_study(STUDY, tmp_path / "dask", DaskPool(address), kill_one)
        repeated = run_study(STUDY, tmp_path / "dask", DaskPool(address))
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


def test_address_without_host_and_port_is_rejected_before_dask_is_imported(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    message = r"^swing_sweep: scheduler '.*' is not the address of a D"
    for x in ("../a/b\\c", "nowhere", "", "tcp://:8786", "tcp://host:99999", "host name:8786"):
        with pytest.raises(bd.BeamdaeError, match=message):
            bd.sweep(swing, {"mass": [1.0]}, scheduler=x)


@pytest.mark.parametrize("address", ["host:8786", "tcp://10.0.0.1:8786", "tls://[fe80::1%eth0]:1"])
def test_message_without_dask(address, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(bd.BeamdaeError, match=r"^--scheduler .* requires Dask, which is not inst"):
        DaskPool(address, "--scheduler")


@pytest.mark.slow(reason="waits for an answer")
@pytest.mark.usefixtures("distributed")
def test_missing_scheduler_is_an_error(monkeypatch):
    monkeypatch.setattr("beamdae.studies.execution.executors._CONNECT_TIMEOUT", 0.2)
    with pytest.raises(bd.BeamdaeError, match=r"scheduler tcp://127\.0\.0\.1:9 does not answer"):
        DaskPool("tcp://127.0.0.1:9")
