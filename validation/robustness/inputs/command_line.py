"""Bad model files and bad command lines."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest import mock

from typer.testing import CliRunner

from beamdae.cli.app import app
from beamdae.studies.execution.executors import SerialPool
from robustness.inputs.bad_input import BadInput
from robustness.judge import TrialOutcome, outcome_of_command, outcome_of_exception

GOOD_MODEL = """import beamdae as bd


@bd.model(t_end=0.01)
def swing(mass=1.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, 0.1, (1.0, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(1.0, 0.0))
    # more
    return mech
"""


def add_line(line: str) -> str:
    """Return the good model file with one more line in its function."""
    return GOOD_MODEL.replace("# more", line)


def _write_function(head: str, body: str = "return bd.Mechanism()") -> str:
    """Return a model file with a function of this signature and body."""
    return f"import beamdae as bd\n\n@bd.model(t_end=0.01)\ndef {head}:\n    {body}\n"


MODEL_FILES: dict[str, str | bytes] = {
    "empty": "",
    "only a comment": "# nothing\n",
    "syntax error": "def swing(:\n",
    "unclosed bracket": GOOD_MODEL + "(\n",
    "tabs and spaces": "if True:\n\tx = 1\n        y = 2\n",
    "Python 2": "print 'here'\n",
    "null bytes": b"import beamdae\0\n",
    "bytes of no encoding": b"\xff\xfe\x00swing = 1\n",
    "latin-1 without saying so": "name = 'H\u00fcgel'\n".encode("latin-1"),
    "unknown encoding": b"# -*- coding: nonsense -*-\n",
    "UTF-16": GOOD_MODEL.encode("utf-16"),
    "UTF-8 with a mark": b"\xef\xbb\xbf" + GOOD_MODEL.encode(),
    "Windows line ends": GOOD_MODEL.replace("\n", "\r\n").encode(),
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)),
    "CSV": "t [s],x [m]\n0,1\n",
    "JSON": '{"model": null}',
    "deep brackets": "x = " + "(" * 1000 + ")" * 1000 + "\n",
    "a million lines' expression": "x = " + "1 + " * 100_000 + "1\n",
    "missing module": "import beamdea\n",
    "missing name": "from beamdae import Sprig\n",
    "missing attribute": "import beamdae as bd\nbd.Sprig\n",
    "itself": "import model\n" + GOOD_MODEL,
    "relative import": "from . import other\n",
    "recursion at import": "def f():\n    return f()\nf()\n",
    "recursion in the function": add_line("f = lambda: f()\n    f()"),
    "recursion of repr": "x = []\nfor _ in range(100000): x = [x]\nraise ValueError(x)\n",
    "sys.exit(0) at import": "import sys\nsys.exit(0)\n",
    "sys.exit in the function": add_line("import sys; sys.exit(0)"),
    "SystemExit of text": "raise SystemExit('no\\nway')\n",
    "interrupt at import": "raise KeyboardInterrupt\n",
    "interrupt in the function": add_line("raise KeyboardInterrupt"),
    "generator exit": "raise GeneratorExit\n",
    "own BaseException": "class E(BaseException): pass\nraise E('x')\n",
    "exception of many lines": "raise ValueError('a\\nb\\n\\x1b[31mc')\n",
    "exception whose text fails": (
        "class E(Exception):\n    def __str__(self):\n        raise RuntimeError\nraise E\n"
    ),
    "exception of half a surrogate": "raise ValueError('\\ud800')\n",
    "exception of a long text": "raise ValueError('x' * 100000)\n",
    "out of memory": "x = bytearray(10**15)\n",
    "assertion": "assert False\n",
    "warning as it is imported": "import warnings\nwarnings.warn('look')\n" + GOOD_MODEL,
    "no model": "x = 1\n",
    "plain function": "def swing():\n    return 1\n",
    "two models": GOOD_MODEL + GOOD_MODEL.replace("swing", "sway").split("\n", 1)[1],
    "a model of one name twice": GOOD_MODEL + "\nother = swing\n",
    "a class for a model": _write_function("swing()")
    .replace("def swing()", "class swing")
    .replace("return bd.Mechanism()", "pass"),
    "model without t_end": GOOD_MODEL.replace("(t_end=0.01)", "()"),
    "model without brackets": GOOD_MODEL.replace("(t_end=0.01)", ""),
    "t_end of text": GOOD_MODEL.replace("t_end=0.01", "t_end='soon'"),
    "t_end of nan": GOOD_MODEL.replace("t_end=0.01", "t_end=float('nan')"),
    "parameter without default": _write_function("swing(mass)"),
    "any parameters": _write_function("swing(*masses, **more)"),
    "positional only": _write_function("swing(mass=1.0, /)"),
    "asynchronous": _write_function("swing()").replace("def ", "async def "),
    "generator function": _write_function("swing()", "yield bd.Mechanism()"),
    "returns nothing": _write_function("swing()", "pass"),
    "returns a number": _write_function("swing()", "return 1"),
    "returns a class": _write_function("swing()", "return bd.Mechanism"),
    "returns a part": _write_function("swing()", "return bd.RigidBody('bob', 1.0, 1.0)"),
    "returns itself": _write_function("swing()", "return swing"),
    "returns a model": GOOD_MODEL
    + "\n@bd.model(t_end=0.01)\ndef twice():\n    return swing\ndel swing\n",
    "returns nothing in it": _write_function("swing()"),
    "named by markup": add_line("mech.observe('[/bold][red]', bob.at(0.0, 0.0))"),
    "named by control characters": add_line("mech.observe('\\x1b[2J\\r\\x07', bob.at(0.0, 0.0))"),
    "named by a line break": add_line("mech.observe('a\\nb', bob.at(0.0, 0.0))"),
    "named by half a surrogate": add_line("mech.observe('\\ud800', bob.at(0.0, 0.0))"),
    "named by formulas": add_line("mech.observe('=1+1', bob.at(0.0, 0.0))"),
    "named by commas and quotes": add_line("mech.observe('a,\"b', bob.at(0.0, 0.0))"),
    "named by other letters": add_line("mech.observe('\u03b8 \u632f\u308a\u5b50', bob.at(0, 0))"),
    "error in the function": add_line("1 / 0"),
    "error with an address": add_line("raise ValueError(object())"),
    "law that fails": add_line("mech.add(bd.Moment('m', bob.at(0, 0), lambda t: t.nothing))"),
}
# Each file changes or ends the process that imports it, and so runs in a separate process.
PROCESS_CHANGING_FILES: dict[str, str] = {
    "closes standard output": "import sys\nsys.stdout.close()\n" + GOOD_MODEL,
    "changes folder": "import os\nos.chdir('/')\n" + GOOD_MODEL,
    "prints": GOOD_MODEL.replace("import beamdae as bd", "import beamdae as bd\nprint('here')"),
    "raises the recursion limit": "import sys\nsys.setrecursionlimit(10)\n" + GOOD_MODEL,
    "starts a thread": (
        "import threading, time\n"
        "threading.Thread(target=time.sleep, args=(1,), daemon=True).start()\n" + GOOD_MODEL
    ),
    "turns warnings into errors": "import warnings\nwarnings.simplefilter('error')\n" + GOOD_MODEL,
    "turns numpy's warnings into errors": "import numpy\nnumpy.seterr(all='raise')\n" + GOOD_MODEL,
    "sets the rounding of printing": "import numpy\nnumpy.set_printoptions(precision=1)\n"
    + GOOD_MODEL,
    "replaces a part of beamdae": GOOD_MODEL + "\nbd.Mechanism.add = None\n",
    "os._exit at import": "import os\nos._exit(3)\n",
    "abort at import": "import os\nos.abort()\n",
    "kills itself": "import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n",
    "does not end": "while True: pass\n",
}
_UNFIXABLE_FILES = {
    "os._exit at import": "a process that ends itself cannot say anything",
    "abort at import": "a process that ends itself cannot say anything",
    "kills itself": "a process that ends itself cannot say anything",
    "does not end": "whether a program ends cannot be known before it does",
}
# Names that a refusal of a model file may contain.
_FILE_WORDS = ("model.py", "swing", "twice", "bob", "m", "a", "model", "simulate", "Mechanism")
_PROCESS_TIME_LIMIT = 15.0  # s
_MAX_NAME_LENGTH = 80  # characters of a command line in the name of its input


def file_inputs() -> Iterator[BadInput]:
    """Yield every model file for `beamdae run` and, to test reading alone, for `beamdae list`."""
    for name, text in MODEL_FILES.items():
        for place, command in (("file", "run"), ("file listed", "list")):
            yield BadInput(
                place,
                name,
                lambda words, command=command, text=text: _read_model_file(command, text),
                _FILE_WORDS,
                exempt=True,
            )
    for name, text in PROCESS_CHANGING_FILES.items():
        yield BadInput(
            "file",
            name,
            lambda words, text=text: _run_in_process(text),
            _FILE_WORDS,
            _UNFIXABLE_FILES.get(name, ""),
            exempt=True,
        )


def write_model_file(text: str | bytes) -> Path:
    """Write the model file into the folder whose content may remain."""
    Path("out").mkdir(exist_ok=True)
    path = Path("out/model.py")
    path.write_bytes(text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text)
    return path


def _read_model_file(command: str, text: str | bytes) -> TrialOutcome:
    path = write_model_file(text)
    options = ["--no-estimate", "--out", "out"] if command == "run" else []
    return invoke_command([command, str(path), *options])


def _run_in_process(text: str) -> TrialOutcome:
    path = write_model_file(text)
    command = [sys.executable, "-m", "beamdae", "run", str(path), "--no-estimate", "--out", "out"]
    process = subprocess.run(
        command, capture_output=True, text=True, timeout=_PROCESS_TIME_LIMIT, check=False
    )
    # Tables of a successful run are expected.
    tables = "" if process.returncode == 0 else process.stdout
    return outcome_of_command(process.returncode, tables, process.stderr)


# FILE is replaced by the good model file; `_write_folder` creates the other files and folders.
GOOD_FILE = "out/model.py"
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
    "run FILE --integrator generalized-alpha --option rho_inf=2",
    "run FILE --integrator generalized-alpha --option rho_inf=-1",
    "run FILE --integrator generalized-alpha --option error_control=all",
    "run FILE --integrator generalized-alpha --option formulation=ggl",
    "run FILE --integrator ida --option rho_inf=0.5",
    "run FILE --integrator ida --option formulation=index4",
    "run FILE --integrator ida --option formulation=index3",
    "run FILE --integrator ida --option max_order=6",
    "run FILE --integrator ida --option max_order=0",
    "run FILE --integrator ida --option max_order=two",
    "run FILE --integrator ida --option max_order=''",
    "run FILE --integrator ida --option max_order=\u0662",
    "run FILE --integrator ida --option max_order=\u00b2",
    "run FILE --integrator ida --option error_control=none",
    "run FILE --integrator radau --option error_control=all",
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
    "run FILE --accuracy 0",
    "run FILE --accuracy=-1",
    "run FILE --accuracy 100%",
    "run FILE --accuracy nan",
    "run FILE --accuracy soon",
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
    "static FILE --max-points 0",
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


def command_inputs() -> Iterator[BadInput]:
    """Yield every command line, run in a folder with good and bad files."""
    for line in COMMANDS:
        yield BadInput(
            "command",
            line[:_MAX_NAME_LENGTH] or "none",
            lambda words, line=line: _run_command_line(line),
            (),
        )


def _run_command_line(line: str) -> TrialOutcome:
    _write_folder()
    arguments = [GOOD_FILE if word == "FILE" else word for word in shlex.split(line)]
    if arguments[:1] in (["run"], ["compare"], ["sweep"]) and "--out" not in arguments:
        arguments[1:1] = ["--out", "out"]
    return invoke_command(arguments)


def _write_folder() -> None:
    write_model_file(GOOD_MODEL)
    out = Path("out")
    (out / "empty").mkdir()
    (out / "folder.py").mkdir()
    (out / "model.txt").write_text(GOOD_MODEL)
    (out / "dangling.py").symlink_to("nowhere.py")
    (out / "forbidden.py").write_text(GOOD_MODEL)
    (out / "forbidden.py").chmod(0)


def invoke_command(arguments: list[str]) -> TrialOutcome:
    """Run a command in this process, the cases of a study one after the other."""
    with mock.patch("beamdae.studies.execution.executors.LocalPool", return_value=SerialPool()):
        result = CliRunner().invoke(app, arguments, prog_name="beamdae")
    error = result.exception
    if error is not None and not isinstance(error, SystemExit):
        return outcome_of_exception(error)
    # Without a command, or without its required argument, beamdae correctly shows its help.
    shows_help = not arguments or result.stdout.lstrip().startswith("Usage:")
    # A usage error must not print tables.
    tables = result.stdout if result.exit_code == 2 and not shows_help else ""
    outcome = outcome_of_command(result.exit_code, tables, result.stderr)
    if shows_help and not outcome.text:
        return replace(outcome, ended="ran", output="")
    return outcome
