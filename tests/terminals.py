"""The command in processes of its own: in a terminal of some width, or with streams as given."""

import os
import re
import subprocess
import sys

COMMAND = (sys.executable, "-m", "beamdae")


def process(*arguments, prefix=(), **settings):
    """A process of the command; its streams are pipes unless told otherwise."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    environment = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "NO_COLOR")}
    environment |= settings.pop("environment", {})
    return subprocess.Popen([*prefix, *COMMAND, *arguments], env=environment, **pipes | settings)


def shell(line, **settings):
    """Exit code, output and errors of a line of the shell; {beamdae} is the command."""
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line.format(beamdae=" ".join(COMMAND))],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=120,
        check=False,
        **settings,
    )
    return done.returncode, done.stdout, done.stderr


def in_terminal(columns, *arguments, environment=()):
    """Exit code, and the lines and frames of a command in a terminal of so many columns."""
    import fcntl
    import pty
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    command = process(
        *arguments,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        environment={"TERM": "xterm-256color", **dict(environment)},
    )
    os.close(theirs)
    said = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:
            break
        if not part:
            break
        said += part
    os.close(ours)
    text = said.decode()
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    return command.wait(60), [line for line in re.split(r"[\r\n]+", plain) if line.strip()], text
