"""Run the command `beamdae` in a process, in a shell, or in a terminal."""

import os
import re
import subprocess
import sys

COMMAND = (sys.executable, "-m", "beamdae")


def process(*arguments, prefix=(), **settings):
    """Start the command and return its process; streams are pipes unless `settings` differ."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    environment = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "NO_COLOR")}
    environment |= settings.pop("environment", {})
    return subprocess.Popen([*prefix, *COMMAND, *arguments], env=environment, **pipes | settings)


def shell(line, **settings):
    """Return exit code, output and errors of a shell command; {beamdae} is the command."""
    result = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line.format(beamdae=" ".join(COMMAND))],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=120,
        check=False,
        **settings,
    )
    return result.returncode, result.stdout, result.stderr


def in_terminal(columns, *arguments, environment=()):
    """Return exit code, lines and raw output of a command in a terminal of this width."""
    import fcntl
    import pty
    import struct
    import termios

    parent, child = pty.openpty()
    fcntl.ioctl(child, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    command = process(
        *arguments,
        stdin=child,
        stdout=child,
        stderr=child,
        environment={"TERM": "xterm-256color", **dict(environment)},
    )
    os.close(child)
    output = b""
    while True:
        try:
            block = os.read(parent, 65536)
        except OSError:
            break
        if not block:
            break
        output += block
    os.close(parent)
    text = output.decode()
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", text)
    return command.wait(60), [line for line in re.split(r"[\r\n]+", plain) if line.strip()], text
