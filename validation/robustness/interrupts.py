"""Interrupts of every analysis and command, every 5 ms through a cold start.

Each trial is a process with an empty cache of machine code, which receives one SIGINT at a given
time after the start of the call; commands also receive SIGTERM and SIGHUP. The interrupt must end
the call within a few seconds, and files named in the message of a command must be complete.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]

# Expressions that are interrupted; `model` is a pendulum with a beam.
CALLS = {
    "simulate, auto": "bd.simulate(model)",
    "simulate, ida": "bd.simulate(model, bd.Ida())",
    "simulate, radau": "bd.simulate(model, bd.Radau())",
    "simulate, alpha": "bd.simulate(model, bd.GeneralizedAlpha(step=1e-3))",
    "equilibrium": "bd.equilibrium(model)",
    "modes": "bd.modes(model)",
    "buckling": "bd.buckling(model)",
    "campbell": "bd.campbell(model, [0.0, 1.0])",
    "linearize": "bd.linearize(model)",
    "periodic": "bd.periodic(model, 0.5, settle=1)",
    "frequency_response": "bd.frequency_response(model, 'frequency', (2.0, 2.1), settle=1)",
    "check": "bd.check(model)",
    "accuracy": "bd.simulate(model, accuracy=0.1)",
    "compare": "bd.compare([bd.Case(model, {}, bd.Radau())])",
    "sweep": "bd.sweep(model, {'frequency': [2.0, 3.0]})",
    "verify": "bd.verify(bd.simulate(model, bd.Radau()))",
    "errors": "bd.simulate(model, bd.Radau()).errors",
    "section_forces": "bd.simulate(model, bd.Radau()).section_forces('beam')",
}
COMMANDS = {
    "beamdae run": ("run", "model.py"),
    "beamdae check": ("check", "model.py"),
    "beamdae list": ("list", "."),
    "beamdae draw": ("draw", "model.py"),
    "beamdae static": ("static", "model.py"),
    "beamdae modes": ("modes", "model.py"),
    "beamdae compare": ("compare", "model.py"),
    "beamdae sweep": ("sweep", "model.py", "--over", "frequency=2,3"),
    "beamdae fit": ("fit", "model.py", "data.csv", "--by", "frequency"),
    "beamdae optimize": ("optimize", "model.py", "--by", "frequency", "--minimize", "end:tip.y"),
    "beamdae periodic": ("periodic", "model.py", "--period", "0.5"),
    "beamdae response": ("response", "model.py", "--over", "frequency=2:2.1"),
    "beamdae bode": ("bode", "model.py", "--input", "push.Fy", "--output", "tip.y"),
}
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_DATA = "t [s],tip.y [m]\n0,0\n0.1,-0.001\n0.2,-0.002\n"
_RESULTS = "the results so far are in "
# Moments of the interrupts after the start of a call. A cold start takes one to three seconds.
_INTERVAL, _LAST_MOMENT = 0.005, 3.0  # s
# An interrupt is lost if its call goes on for longer; machines may be busy.
_MAX_TIME_AFTER_INTERRUPT = 10.0  # s
# Calls that end within this time of the interrupt have ended by themselves.
_SIMULTANEOUS = 0.05  # s
_PROCESS_TIME_LIMIT = 300.0  # s

MODEL = """
import beamdae as bd

@bd.model(t_end=0.2)
def model(frequency=2.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    steel = bd.Material(E=210e9, nu=0.3, rho=7850.0)
    strip = bd.Section.rectangle(steel, width=0.02, height=0.01, damping=1e-3)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (1.0, 0.0)), strip, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (0.0, bd.sine(1.0, frequency=frequency))))
    mech.observe("tip", beam.end)
    return mech
"""
_PROGRAM = """
import json, os, signal, sys, threading, time
signal.signal(signal.SIGINT, signal.default_int_handler)
sent = []
def send():
    time.sleep({delay})
    sent.append(time.monotonic())
    os.kill(os.getpid(), signal.SIGINT)
thread = threading.Thread(target=send, daemon=True)
ended = "before the call"
try:
    import beamdae as bd
    from model import model
    begin = time.monotonic()
    thread.start()
    try:
        {call}
        ended = "returned"
    except KeyboardInterrupt as interrupt:
        ended = "raised"
    except BaseException as problem:
        ended = type(problem).__name__ + ": " + str(problem)
    end = time.monotonic()
    thread.join()
    time.sleep(0.5)
except KeyboardInterrupt:
    pass
print(json.dumps({{"ended": ended, "after": end - sent[0] if sent else None}}))
"""


def list_names() -> list[str]:
    """Return the names of all trials: each call and command at each moment."""
    count = round(_LAST_MOMENT / _INTERVAL)
    return [
        f"{name} at {k * _INTERVAL:.3f} s"
        for name in (*CALLS, *(f"{x}, {s.name}" for x in COMMANDS for s in SIGNALS))
        for k in range(1, count + 1)
    ]


def try_name(trial: str) -> list[str]:
    """Interrupt a call or command in a process with an empty cache, and return the complaint."""
    name, _, moment = trial.rpartition(" at ")
    with tempfile.TemporaryDirectory(prefix="robustness-") as scratch:
        folder = Path(scratch)
        (folder / "model.py").write_text(MODEL, encoding="utf-8")
        (folder / "data.csv").write_text(_DATA, encoding="utf-8")
        environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "OPENBLAS_NUM_THREADS": "1",
            "XDG_CACHE_HOME": str(folder / "cache"),
        }
        attempt = _try_call if name in CALLS else _try_command
        return [attempt(name, float(moment.split()[0]), folder, environment)]


def _try_call(name: str, delay: float, folder: Path, environment: dict[str, str]) -> str:
    program = _PROGRAM.format(delay=delay, call=CALLS[name])
    try:
        process = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", program],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=_PROCESS_TIME_LIMIT,
        )
    except subprocess.TimeoutExpired:
        return "the call went on"
    lines = process.stdout.splitlines()
    if not lines:
        return f"it crashed: {process.stderr[-200:]}"
    result = json.loads(lines[-1])
    ended, after = result["ended"], result["after"]
    if ended == "returned":
        is_lost = after is not None and after > _SIMULTANEOUS
        return "lost" if is_lost else ""
    if ended != "raised":
        return f"another exception: {ended}"
    is_late = after > _MAX_TIME_AFTER_INTERRUPT
    return f"{after:.1f} s later" if is_late else ""


def _try_command(name: str, delay: float, folder: Path, environment: dict[str, str]) -> str:
    command, _, signal_name = name.rpartition(", ")
    number = signal.Signals[signal_name]
    process = subprocess.Popen(
        [sys.executable, "-m", "beamdae", *COMMANDS[command]],
        cwd=folder,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # Processes in the background or of nohup ignore signals, and so do those that they start.
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    time.sleep(delay)
    is_running = process.poll() is None
    sent = time.monotonic()
    if is_running:
        process.send_signal(number)
    try:
        _, errors = process.communicate(timeout=_PROCESS_TIME_LIMIT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return "the command went on"
    after, code = time.monotonic() - sent, process.returncode
    if not is_running or (code == 0 and after < _SIMULTANEOUS):
        return ""
    # The interrupt may hit the start of Python and the import of the package, which precede the
    # command line.
    is_early = code in (-number, 1) and "beamdae/cli/" not in errors
    if code != 128 + number and not is_early:
        return f"code {code}: {errors[-200:] or 'lost'}"
    if "Traceback" in errors and not is_early:
        return f"traceback: {errors[-200:]}"
    if remains := [x.name for x in folder.rglob("*.scratch")]:
        return f"unfinished files: {remains}"
    if _RESULTS in errors:
        file = folder / errors.rpartition(_RESULTS)[2].splitlines()[0].strip()
        # Tables of a study are in a folder; pictures begin with a line break, too.
        files = [file] if file.is_file() else [*file.glob("*.csv")]
        if not files or not all(b"\n" in x.read_bytes() for x in files):
            return f"no results in {file.name}"
    is_late = after > _MAX_TIME_AFTER_INTERRUPT
    return f"{after:.1f} s later" if is_late else ""
