"""The same study on a Dask cluster: one of its workers is killed in the middle."""

from __future__ import annotations

import os
import signal

import pandas as pd
import pytest

import beamdae as bd
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import DaskPool, SerialPool


@pytest.fixture
def distributed():
    """Imported by the tests that need it alone, as it takes long."""
    return pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")


# Dask and Tornado of one environment may be of different age; their warnings are not ours.
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


@bd.model(t_end=0.2)
def swing(mass=2.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("end", bob.at(2.0, 0.0))
    return mech


STUDY = bd.Study(
    "swings",
    tuple(
        bd.Case(swing, {"mass": mass}, bd.GeneralizedAlpha(step=h))
        for mass in (1.0, 2.0, 3.0)
        for h in (2e-3, 1e-3, 5e-4, 2e-4)
    ),
    references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=5e-4)),
)
# What differs from run to run and from process to process.
UNSTEADY = ["wall time [s]", "setup time [s]", "measuring time [s]", "peak memory [GB]"]


@pytest.mark.slow(reason="starts a scheduler and two workers")
def test_a_study_survives_a_killed_worker_and_gives_the_serial_table(tmp_path, distributed):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        address = cluster.scheduler_address
        victims = [worker.process.pid for worker in cluster.workers.values()]

        def kill_one(progress):
            if progress.done == 4 and len(victims) == 2:
                os.kill(victims.pop(), signal.SIGKILL)

        found = study_run.run_study(STUDY, tmp_path / "dask", DaskPool(address), kill_one)
        again = study_run.run_study(STUDY, tmp_path / "dask", DaskPool(address))
        # Nothing was left to do, and its connection is closed nevertheless.
        with pytest.raises(ValueError, match="No clients found"):
            distributed.Client.current()
        over = {"mass": [1.0, -1.0, 2.0]}
        outputs = {"rows": lambda run: len(run.t)}
        with pytest.warns(bd.BeamdaeWarning, match="1 of 3 runs did not reach their end"):
            swept = bd.sweep(swing, over, outputs=outputs, scheduler=address)
    assert list(swept.table["rows"].fillna(0.0)) == [401.0, 0.0, 401.0]
    assert len(victims) == 1
    assert len(again.table) == len(STUDY.cases)
    serial = study_run.run_study(STUDY, tmp_path / "serial", SerialPool())
    assert set(found.table["status"]) == {"ok"}
    pd.testing.assert_frame_equal(
        found.table.drop(columns=UNSTEADY), serial.table.drop(columns=UNSTEADY)
    )


@pytest.mark.slow(reason="waits for an answer")
@pytest.mark.usefixtures("distributed")
def test_a_scheduler_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setattr("beamdae.studies.execution.executors._CONNECT_TIMEOUT", 0.2)
    with pytest.raises(bd.BeamdaeError, match=r"--scheduler tcp://127\.0\.0\.1:9: no Dask sched"):
        DaskPool("tcp://127.0.0.1:9")
