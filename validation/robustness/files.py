"""Bad model files: what they hold, and how they are read."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from robustness.inputs import Input
from robustness.judge import Seen, command_seen

GOOD = """import beamdae as bd


@bd.model(t_end=0.01)
def swing(mass=1.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, 0.1, (1.0, 0.0)))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("bob", bob.at(1.0, 0.0))
    # more
    return mech
"""


def more(line: str) -> str:
    """The good file with a line more in its function."""
    return GOOD.replace("# more", line)


def _function(head: str, body: str = "return bd.Mechanism()") -> str:
    return f"import beamdae as bd\n\n@bd.model(t_end=0.01)\ndef {head}:\n    {body}\n"


FILES: dict[str, str | bytes] = {
    "empty": "",
    "only a comment": "# nothing\n",
    "syntax error": "def swing(:\n",
    "unclosed bracket": GOOD + "(\n",
    "tabs and spaces": "if True:\n\tx = 1\n        y = 2\n",
    "Python 2": "print 'here'\n",
    "null bytes": b"import beamdae\0\n",
    "bytes of no encoding": b"\xff\xfe\x00swing = 1\n",
    "latin-1 without saying so": "name = 'H\u00fcgel'\n".encode("latin-1"),
    "unknown encoding": b"# -*- coding: nonsense -*-\n",
    "UTF-16": GOOD.encode("utf-16"),
    "UTF-8 with a mark": b"\xef\xbb\xbf" + GOOD.encode(),
    "Windows line ends": GOOD.replace("\n", "\r\n").encode(),
    "a picture": b"\x89PNG\r\n\x1a\n" + bytes(range(256)),
    "CSV": "t [s],x [m]\n0,1\n",
    "JSON": '{"model": null}',
    "deep brackets": "x = " + "(" * 1000 + ")" * 1000 + "\n",
    "a million lines' expression": "x = " + "1 + " * 100_000 + "1\n",
    "missing module": "import beamdea\n",
    "missing name": "from beamdae import Sprig\n",
    "missing attribute": "import beamdae as bd\nbd.Sprig\n",
    "itself": "import model\n" + GOOD,
    "relative import": "from . import other\n",
    "recursion at import": "def f():\n    return f()\nf()\n",
    "recursion in the function": more("f = lambda: f()\n    f()"),
    "recursion of repr": "x = []\nfor _ in range(100000): x = [x]\nraise ValueError(x)\n",
    "sys.exit(0) at import": "import sys\nsys.exit(0)\n",
    "sys.exit in the function": more("import sys; sys.exit(0)"),
    "SystemExit of text": "raise SystemExit('no\\nway')\n",
    "interrupt at import": "raise KeyboardInterrupt\n",
    "interrupt in the function": more("raise KeyboardInterrupt"),
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
    "warning as it is imported": "import warnings\nwarnings.warn('look')\n" + GOOD,
    "no model": "x = 1\n",
    "plain function": "def swing():\n    return 1\n",
    "two models": GOOD + GOOD.replace("swing", "sway").split("\n", 1)[1],
    "a model of one name twice": GOOD + "\nother = swing\n",
    "a class for a model": _function("swing()")
    .replace("def swing()", "class swing")
    .replace("return bd.Mechanism()", "pass"),
    "model without t_end": GOOD.replace("(t_end=0.01)", "()"),
    "model without brackets": GOOD.replace("(t_end=0.01)", ""),
    "t_end of text": GOOD.replace("t_end=0.01", "t_end='soon'"),
    "t_end of nan": GOOD.replace("t_end=0.01", "t_end=float('nan')"),
    "parameter without default": _function("swing(mass)"),
    "any parameters": _function("swing(*masses, **more)"),
    "positional only": _function("swing(mass=1.0, /)"),
    "asynchronous": _function("swing()").replace("def ", "async def "),
    "generator function": _function("swing()", "yield bd.Mechanism()"),
    "returns nothing": _function("swing()", "pass"),
    "returns a number": _function("swing()", "return 1"),
    "returns a class": _function("swing()", "return bd.Mechanism"),
    "returns a part": _function("swing()", "return bd.RigidBody('bob', 1.0, 1.0)"),
    "returns itself": _function("swing()", "return swing"),
    "returns a model": GOOD
    + "\n@bd.model(t_end=0.01)\ndef twice():\n    return swing\ndel swing\n",
    "returns nothing in it": _function("swing()"),
    "named by markup": more("mech.observe('[/bold][red]', bob.at(0.0, 0.0))"),
    "named by control characters": more("mech.observe('\\x1b[2J\\r\\x07', bob.at(0.0, 0.0))"),
    "named by a line break": more("mech.observe('a\\nb', bob.at(0.0, 0.0))"),
    "named by half a surrogate": more("mech.observe('\\ud800', bob.at(0.0, 0.0))"),
    "named by formulas": more("mech.observe('=1+1', bob.at(0.0, 0.0))"),
    "named by commas and quotes": more("mech.observe('a,\"b', bob.at(0.0, 0.0))"),
    "named by other letters": more("mech.observe('\u03b8 \u632f\u308a\u5b50', bob.at(0, 0))"),
    "error in the function": more("1 / 0"),
    "error with an address": more("raise ValueError(object())"),
    "law that fails": more("mech.add(bd.Moment('m', bob.at(0, 0), lambda t: t.nothing))"),
}
# Each does something to the process it is read in, and is read in one of its own.
WILD: dict[str, str] = {
    "closes standard output": "import sys\nsys.stdout.close()\n" + GOOD,
    "changes folder": "import os\nos.chdir('/')\n" + GOOD,
    "prints": GOOD.replace("import beamdae as bd", "import beamdae as bd\nprint('here')"),
    "raises the recursion limit": "import sys\nsys.setrecursionlimit(10)\n" + GOOD,
    "starts a thread": (
        "import threading, time\n"
        "threading.Thread(target=time.sleep, args=(1,), daemon=True).start()\n" + GOOD
    ),
    "turns warnings into errors": "import warnings\nwarnings.simplefilter('error')\n" + GOOD,
    "takes numpy's errors serious": "import numpy\nnumpy.seterr(all='raise')\n" + GOOD,
    "sets the rounding of printing": "import numpy\nnumpy.set_printoptions(precision=1)\n" + GOOD,
    "replaces a part of beamdae": GOOD + "\nbd.Mechanism.add = None\n",
    "os._exit at import": "import os\nos._exit(3)\n",
    "abort at import": "import os\nos.abort()\n",
    "kills itself": "import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n",
    "does not end": "while True: pass\n",
}
_HOPELESS = {
    "os._exit at import": "a process that ends itself cannot say anything",
    "abort at import": "a process that ends itself cannot say anything",
    "kills itself": "a process that ends itself cannot say anything",
    "does not end": "a file is a program, and whether it ends is not known before it does",
}
_WORDS = (
    "model.py",
    "swing",
    "twice",
    "bob",
    "m",
    "a",
    "model",
    "simulate",
    "Mechanism",
    "own code",
)


def file_inputs() -> Iterator[Input]:
    """Every file by `beamdae run`, and by `beamdae list` what stands for reading alone."""
    for name, text in FILES.items():
        yield Input("file", name, lambda words, text=text: _read("run", text), _WORDS)
        yield Input("file listed", name, lambda words, text=text: _read("list", text), _WORDS)
    for name, text in WILD.items():
        yield Input(
            "file", name, lambda words, text=text: _process(text), _WORDS, _HOPELESS.get(name, "")
        )


def written(text: str | bytes) -> Path:
    """The file, in the folder of what may be left."""
    Path("out").mkdir(exist_ok=True)
    path = Path("out/model.py")
    path.write_bytes(text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text)
    return path


def _read(command: str, text: str | bytes) -> Seen:
    from robustness.commands import invoked

    path = written(text)
    more = ["--no-estimate", "--out", "out"] if command == "run" else []
    return invoked([command, str(path), *more])


def _process(text: str) -> Any:
    path = written(text)
    command = [sys.executable, "-m", "beamdae", "run", str(path), "--no-estimate", "--out", "out"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=15, check=False)
    return command_seen(done.returncode, "" if done.returncode == 0 else done.stdout, done.stderr)
