"""Bad model files and bad command lines."""

import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest import mock

from robustness.inputs.bad_input import BadInput
from robustness.judge import TrialOutcome, outcome_of_command, outcome_of_exception
from typer.testing import CliRunner

from beamdae.cli.app import app
from beamdae.studies.executors import SerialPool

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
COMMANDS = Path(__file__).with_name("commands.txt").read_text("utf-8").splitlines()


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
    with mock.patch("beamdae.studies.executors.LocalPool", return_value=SerialPool()):
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
