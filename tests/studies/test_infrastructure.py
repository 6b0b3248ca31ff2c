"""Studies whose processes, cluster, folder or limits fail: no orphans, no lost or wrong rows."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import invoke
from study_models import swing
from study_runs import LosingPool, SerialPool, run_study

import beamdae as bd

MODEL = """import os
import sys
import time

import beamdae as bd


@bd.model(t_end=0.05)
def swing(mass=1.0):
    BODY
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, 0.1, (1.0, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(1.0, 0.0))
    return mech
"""
OVER = ("--over", "mass=1,2,3")


STUDY = bd.results.Study("swings", tuple(bd.Case(swing, {"mass": m}) for m in (1.0, 2.0, 3.0)))


# Reasons and cells ----------------------------------------------------------------------------


@pytest.mark.slow(reason="draws pictures")
def test_exit_code_of_a_study_with_lost_tasks(tmp_path, monkeypatch):
    executor = "beamdae.studies.executors.create_executor"
    monkeypatch.setattr(executor, lambda *_: LosingPool())
    model = tmp_path / "model.py"
    model.write_text(MODEL.replace("BODY", "pass"))
    command = ["sweep", str(model), *OVER, "--out", str(tmp_path / "results")]
    result = invoke(*command)
    assert result.exit_code == 3
    assert "not run: 2 of 3 runs, because connection-lost. Client lost; run the same" in (
        result.output
    )
    assert "failed:" not in result.output


# Processes ------------------------------------------------------------------------------------


def run_beamdae(folder, *arguments, shell="", **options):
    """Start beamdae in a folder after the shell commands `shell`, in an own process group."""
    env = {**os.environ, "PYTHONPATH": str(Path(bd.__file__).parents[1]), "OWNER": folder.name}
    line = f'{shell} exec "$@"'
    return subprocess.Popen(
        ["bash", "-c", line, "bash", sys.executable, "-m", "beamdae", *arguments],
        cwd=folder,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **options,
    )


@pytest.mark.slow(reason="starts a command")
@pytest.mark.parametrize("limit", [14, 20, 32])
def test_study_works_with_few_open_files(tmp_path, limit):
    (tmp_path / "model.py").write_text(MODEL.replace("BODY", "pass"))
    command = ("sweep", "model.py", *OVER, "--jobs", "2")
    process = run_beamdae(tmp_path, *command, shell=f"ulimit -n {limit};")
    _, err = process.communicate(timeout=120.0)
    assert process.returncode == 0
    assert "Traceback" not in err
    assert err.count("warning: ") == err.count("worker processes can be started") <= 1


def find_processes(owner):
    """Return the processes with this owner in their environment, in any process group."""
    processes = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"OWNER={owner}".encode() in path.read_bytes().split(b"\0"):
                processes.append(int(path.parent.name))
        except OSError:
            pass
    return processes


def wait_until(condition):
    """Wait until a condition is true; a minute covers a busy machine."""
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow(reason="starts processes")
@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="no /proc")
def test_regression_workers_end_with_a_killed_study(tmp_path):
    """They used to compute until their case ended, and competed with the resumed study."""
    # A busy loop, during which the process reads nothing from its parent.
    body = (
        "marker = open(f'{mass}.txt', 'w')\n    while mass > 1.0 and not os.path.exists('go'): pass"
    )
    (tmp_path / "model.py").write_text(MODEL.replace("BODY", body))
    command = ("sweep", "model.py", *OVER, "--jobs", "2")
    process = run_beamdae(tmp_path, *command)
    wait_until(lambda: len([*tmp_path.glob("[23].0.txt"), *tmp_path.rglob("outcomes/*.json")]) == 3)
    wait_until(lambda: len(find_processes(tmp_path.name)) > 2)
    process.kill()
    process.wait()
    # Orphans would keep the pipes open.
    for stream in (process.stdout, process.stderr):
        stream.close()
    wait_until(lambda: not find_processes(tmp_path.name))
    (tmp_path / "go").touch()
    resumed = run_beamdae(tmp_path, *command)
    _, err = resumed.communicate(timeout=120.0)
    assert resumed.returncode == 0, err
    assert "1 stored before" in err


# Folders --------------------------------------------------------------------------------------


@pytest.mark.slow(reason="half a second")
def test_results_folder_is_locked_while_a_study_runs(tmp_path):
    def start_another(progress):
        with pytest.raises(bd.BeamdaeError, match=r"another process is running a study"):
            run_study(STUDY, tmp_path, SerialPool())

    run_study(STUDY, tmp_path, SerialPool(), start_another)
    run_study(STUDY, tmp_path, SerialPool())


@pytest.mark.slow(reason="half a second")
def test_deleted_working_folder_is_reported(tmp_path, monkeypatch):
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)

    def delete(progress):
        if folder.exists() and progress.done:
            for path in sorted(folder.rglob("*"), reverse=True):
                path.rmdir() if path.is_dir() else path.unlink()
            folder.rmdir()

    with pytest.raises(bd.BeamdaeError, match=r"^results/.*: the working folder has been deleted"):
        bd.sweep(swing, {"mass": [1.0, 2.0]}, folder="results", progress=delete)
    # Without a folder, results need no working folder.
    assert list(bd.sweep(swing, {"mass": [1.0, 2.0]}).table["status"]) == ["ok", "ok"]
