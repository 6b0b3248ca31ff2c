"""Kernels of notebooks as forks of one process, which imports beamdae and its packages once.

Starting an interpreter and importing the packages takes longer than running most pages.
"""

import atexit
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

# Packages that notebooks import, also those that beamdae imports when it needs them.
_PACKAGES = (
    "ipykernel.ipkernel",
    "ipykernel.kernelapp",
    "matplotlib.pyplot",
    "pandas",
    "scipy.optimize",
)


def start():
    """Start the server, and make its forks the kernels of notebooks in this process."""
    folder = tempfile.TemporaryDirectory(prefix="kernels-")
    address = os.path.join(folder.name, "socket")
    command = [sys.executable, __file__, "serve", address]
    server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    if not server.stdout.readline():
        raise RuntimeError(f"the server of notebook kernels ended with code {server.wait()}")
    kernel = Path(folder.name, "kernels", "python3", "kernel.json")
    kernel.parent.mkdir(parents=True)
    # The client imports nothing of the environment, so that it starts fast.
    client = [sys.executable, "-S", "-E", __file__, "request", address, "-f", "{connection_file}"]
    kernel.write_text(
        json.dumps({"argv": client, "display_name": "Python 3", "language": "python"})
    )
    paths = (folder.name, os.environ.get("JUPYTER_PATH"))
    os.environ["JUPYTER_PATH"] = os.pathsep.join(filter(None, paths))

    def stop():
        server.stdin.close()
        server.wait()
        folder.cleanup()

    atexit.register(stop)


def serve(address):
    """Fork a kernel for each connection, until the standard input is closed."""
    import importlib

    import beamdae

    # Ctrl-C ends Sphinx, and thereby the server.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in _PACKAGES:
        importlib.import_module(name)
    for name in beamdae.__all__:
        getattr(beamdae, name)
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(address)
    listener.listen()
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    # Nobody reads the pipe of the first line.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    while True:
        ready, _, _ = select.select([listener, sys.stdin], [], [])
        if sys.stdin in ready:
            reap_kernels()
            return
        connection, _ = listener.accept()
        if os.fork() == 0:
            listener.close()
            run_kernel(connection)
            os._exit(0)
        connection.close()
        reap_kernels()


def reap_kernels():
    """Wait for the kernels that have ended."""
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        pass


def run_kernel(connection):
    """Run a kernel in the folder and the environment of its client, and end with the client."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    file = connection.makefile("r")
    request = json.loads(file.readline())
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    # Kernels end with their parent process; without one, they print how to connect to them.
    parent = f"--IPKernelApp.parent_handle={os.getppid()}"
    sys.argv = ["ipykernel_launcher", *request["arguments"], parent]
    sys.path[0] = ""  # instead of the folder of this file
    threading.Thread(target=lambda: (file.read(), os._exit(1)), daemon=True).start()
    from ipykernel.kernelapp import launch_new_instance

    launch_new_instance()


def request(address, *arguments):
    """Request a kernel and wait until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(address)
    content = {"arguments": arguments, "folder": os.getcwd(), "environment": dict(os.environ)}
    connection.sendall(json.dumps(content).encode() + b"\n")
    connection.recv(1)


if __name__ == "__main__":
    {"serve": serve, "request": request}[sys.argv[1]](*sys.argv[2:])
