"""Bad command lines: options, files and folders that are wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest import mock

from robustness.files import GOOD, written
from robustness.inputs import Input
from robustness.judge import Seen, command_seen, raised

# In place of FILE is a good model file; further words are files and folders of `_folder`.
FILE = "out/model.py"
COMMANDS: tuple[str, ...] = (
    "",
    "--nothing",
    "fly",
    "rnu FILE",
    "--version --nothing",
    "run",
    "run nowhere.py",
    "run out",
    "run out/model.txt",
    "run out/folder.py",
    "run out/forbidden.py",
    "run out/dangling.py",
    "run out/pipe.txt",
    "run /dev/null",
    "run FILE FILE",
    "run FILE --nothing",
    "run FILE --set",
    "run FILE --set mass",
    "run FILE --set =1",
    "run FILE --set mass=",
    "run FILE --set mass=heavy",
    "run FILE --set mass=nan",
    "run FILE --set mass=-inf",
    "run FILE --set mass=-1",
    "run FILE --set mass=0",
    "run FILE --set mass=1e999",
    "run FILE --set mass=1e308",
    "run FILE --set mass=1e-320",
    "run FILE --set mass=1j",
    "run FILE --set mass=[1.0]",
    "run FILE --set mass=__import__('os')",
    "run FILE --set weight=1",
    "run FILE --set mass=1 --set mass=2",
    "run FILE --set mass=1_000",
    "run FILE --model",
    "run FILE --model sway",
    "run FILE --model ''",
    "run FILE --integrator",
    "run FILE --integrator euler",
    "run FILE --integrator IDA",
    "run FILE --integrator ''",
    "run FILE --rtol",
    "run FILE --rtol small",
    "run FILE --rtol nan",
    "run FILE --rtol inf",
    "run FILE --rtol 0",
    "run FILE --rtol -1e-3",
    "run FILE --rtol 1",
    "run FILE --rtol 1e-300",
    "run FILE --rtol 1e-17",
    "run FILE --step 1e-3",
    "run FILE --integrator generalized-alpha --step 0",
    "run FILE --integrator generalized-alpha --step -1",
    "run FILE --integrator generalized-alpha --step nan",
    "run FILE --integrator generalized-alpha --step 1e-30",
    "run FILE --integrator generalized-alpha --step 1e30",
    "run FILE --integrator generalized-alpha --rho-inf 2",
    "run FILE --integrator generalized-alpha --rho-inf -1",
    "run FILE --integrator generalized-alpha --error-control all",
    "run FILE --integrator generalized-alpha --formulation ggl",
    "run FILE --integrator ida --rho-inf 0.5",
    "run FILE --integrator ida --formulation index4",
    "run FILE --integrator ida --formulation index3",
    "run FILE --integrator ida --max-order 6",
    "run FILE --integrator ida --max-order 0",
    "run FILE --integrator ida --max-order two",
    "run FILE --integrator ida --max-order ''",
    "run FILE --integrator ida --max-order \u0662",
    "run FILE --integrator ida --max-order \u00b2",
    "run FILE --integrator ida --error-control none",
    "run FILE --integrator radau --error-control all",
    "run FILE --t-end",
    "run FILE --t-end soon",
    "run FILE --t-end 0",
    "run FILE --t-end -1",
    "run FILE --t-end nan",
    "run FILE --t-end inf",
    "run FILE --t-end 1e-320",
    "run FILE --t-end 1e-15",
    "run FILE --output-step 0",
    "run FILE --output-step -1",
    "run FILE --output-step nan",
    "run FILE --output-step inf",
    "run FILE --output-step 1e-320",
    "run FILE --output-step 1e-12",
    "run FILE --output-step 1",
    "run FILE --out",
    "run FILE --out out/model.py",
    "run FILE --out out/model.py/deeper",
    "run FILE --out /proc/nowhere",
    "run FILE --out /dev/full",
    f"run FILE --out out/{'x' * 300}",
    "run FILE --estimate --no-estimate",
    "run FILE --verify --no-estimate",
    "run FILE --time-limit 0",
    "run FILE --time-limit -1",
    "run FILE --time-limit nan",
    "run FILE --time-limit soon",
    "check",
    "check nowhere.py",
    "static",
    "static nowhere.py",
    "static FILE --to x",
    "static FILE --to knee.x=a --to knee.y=1",
    "static FILE --load nothing",
    "static FILE --control sideways",
    "static FILE --switch 1 --control load",
    "static FILE --switch x",
    "static FILE --switch 1 --switch 0",
    "static FILE --most-points 0",
    "new",
    "new FILE",
    "new a.txt",
    "new nowhere/b.py --like nothing",
    "run example:nothing",
    "draw",
    "draw nowhere.py",
    "draw FILE --out FILE",
    "draw FILE --set nothing=1",
    "modes",
    "modes nowhere.py",
    "modes FILE --about nothing",
    "modes FILE -n 0",
    "modes FILE -n x",
    "modes FILE --speed fast",
    "modes FILE --speed nan",
    "modes FILE --speed 1 --about equilibrium",
    "modes FILE --speed 1 --speed 2 --animate 1",
    "modes FILE --animate 0",
    "modes FILE --animate 99",
    "check FILE --rtol 1e-3",
    "check FILE --set mass=-1",
    "check FILE --model sway",
    "list",
    "list nowhere",
    "list nowhere.py",
    "list out/empty",
    "list out/model.txt",
    "list out/dangling.py",
    "compare",
    "compare nowhere.py",
    "compare out",
    "compare FILE --workers 0",
    "compare FILE --workers -1",
    "compare FILE --workers many",
    "compare FILE --workers 1.5",
    "compare FILE --scheduler ''",
    "compare FILE --scheduler nowhere",
    "compare FILE --scheduler tcp://127.0.0.1:1",
    "compare FILE --t-end -1",
    "compare FILE --t-end nan",
    "compare FILE --output-step 0",
    "compare FILE --output-step 1e-300",
    "compare FILE --set mass=-1",
    "compare FILE --set weight=1",
    "compare FILE --set mass=1 --model sway",
    "compare FILE --out out/model.py",
    "compare FILE --out /proc/nowhere",
    "compare FILE --time-limit -1",
    "sweep",
    "sweep nowhere.py",
    "sweep FILE",
    "sweep FILE --model sway",
    "sweep FILE --over mass",
    "sweep FILE --over mass=",
    "sweep FILE --over mass=heavy",
    "sweep FILE --over mass=1,2 --over mass=3",
    "sweep FILE --over mass=1,2 --set mass=3",
    "sweep FILE --over mass=1:2",
    "sweep FILE --over mass=1:2:0",
    "sweep FILE --over mass=1:2:3:4",
    "sweep FILE --over mass=1:2:3:4:5",
    "sweep FILE --over mass=1:nan:3",
    "sweep FILE --over mass=-1:2:3:log",
    "sweep FILE --over mass=1:2:99999999999",
    "sweep FILE --over weight=1",
    "sweep FILE --over mass=-1,-2",
    "sweep FILE --over mass=1 --of nothing",
    "sweep FILE --over mass=1 --integrator euler",
    "sweep FILE --over mass=1 --step 1e-3",
    "sweep FILE --over mass=1 --jobs 0",
    "sweep FILE --over mass=1 --jobs 99999",
    "sweep FILE --over mass=1 --scheduler nowhere",
    "sweep FILE --over mass=1 --t-end -1",
    "sweep FILE --rtol 1e-3",
)


def command_inputs() -> Iterator[Input]:
    """Each of them, in a folder with good and bad files."""
    for line in COMMANDS:
        yield Input("command", line[:80] or "none", lambda words, line=line: _run(line), ())


def _run(line: str) -> Seen:
    import shlex

    _folder()
    arguments = [FILE if word == "FILE" else word for word in shlex.split(line)]
    if arguments[:1] in (["run"], ["compare"], ["sweep"]) and "--out" not in arguments:
        arguments[1:1] = ["--out", "out"]
    return invoked(arguments)


def _folder() -> None:
    written(GOOD)
    out = Path("out")
    (out / "empty").mkdir()
    (out / "folder.py").mkdir()
    (out / "model.txt").write_text(GOOD)
    (out / "dangling.py").symlink_to("nowhere.py")
    (out / "forbidden.py").write_text(GOOD)
    (out / "forbidden.py").chmod(0)


def invoked(arguments: list[str]) -> Seen:
    """A command in this process, a study's cases one after the other."""
    from typer.testing import CliRunner

    from beamdae.cli.app import app
    from beamdae.studies.execution.executors import SerialPool

    with mock.patch("beamdae.studies.execution.executors.LocalPool", return_value=SerialPool()):
        done = CliRunner().invoke(app, arguments, prog_name="beamdae")
    problem = done.exception
    if problem is not None and not isinstance(problem, SystemExit):
        return raised(problem)
    # No command, or one without what it needs, shows its help: that is an answer.
    helped = not arguments or done.stdout.lstrip().startswith("Usage:")
    tables = "" if done.exit_code != 2 or helped else done.stdout
    seen = command_seen(done.exit_code, tables, done.stderr)
    return replace(seen, text="", ended="ran", output="") if helped and not seen.text else seen
