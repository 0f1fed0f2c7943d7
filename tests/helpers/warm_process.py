"""The command line in processes of its own that need not import it: forked from a server that has.

There is one server for each process of the tests. What a process does before its first line (imports, streams that are
closed) is not seen here. All else is: exit codes, signals, terminals, what a killed command leaves.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import json
import os
import runpy
import signal
import socket
import struct
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import IO, Any

NUMBER = struct.Struct("i")
USED = (
    "floatplan.cli.motions",
    "floatplan.cli.study",
    "floatplan.export.formats",
    "floatplan.planning.planner",
    "floatplan.certificate.certificate",
    "floatplan.view.figures.figures",
    "floatplan.view.report.report",
    "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_svg",
)


class WarmProcess:
    """A command that has begun.

    Parameters
    ----------
    arguments : of ``floatplan``
    stdout, stderr : file descriptors
    cwd : its working directory; this process' own if left out
    environment : instead of this process' own
    constants : of the package, by module and name, that have other values in it
    """

    def __init__(
        self,
        *arguments: str | Path,
        stdout: int,
        stderr: int,
        cwd: Path | None = None,
        environment: Mapping[str, str] | None = None,
        constants: Mapping[str, float] | None = None,
    ) -> None:
        request = {
            "arguments": [str(argument) for argument in arguments],
            "cwd": str(cwd or Path.cwd()),
            "environment": dict(os.environ if environment is None else environment),
            "constants": dict(constants or {}),
        }
        self._told, theirs = socket.socketpair()
        with theirs, tempfile.TemporaryFile("w+") as written:
            json.dump(request, written)
            written.seek(0)
            descriptors = [written.fileno(), theirs.fileno(), stdout, stderr]
            socket.send_fds(_server(os.getpid()), [b"?"], descriptors)
        self.pid = self._number()

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code, or minus the number of the signal that ended it.

        Raises
        ------
        TimeoutError
            It has not ended after so many seconds.
        """
        self._told.settimeout(timeout)
        code = self._number()
        self._told.close()
        return code

    def kill(self) -> None:
        """End it at once, and wait until it has ended."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)
        self.wait()

    def interrupt(self) -> None:
        """Send what Ctrl-C in a terminal does: to it and all that it has begun."""
        os.killpg(self.pid, signal.SIGINT)

    def _number(self) -> int:
        return int(NUMBER.unpack(self._told.recv(NUMBER.size, socket.MSG_WAITALL))[0])


def run(*arguments: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    with tempfile.TemporaryFile() as stdout, tempfile.TemporaryFile() as stderr:
        code = WarmProcess(*arguments, stdout=stdout.fileno(), stderr=stderr.fileno(), cwd=cwd).wait()
        return subprocess.CompletedProcess(arguments, code, _text(stdout), _text(stderr))


def _text(stream: IO[bytes]) -> str:
    stream.seek(0)
    return stream.read().decode()


@cache
def _server(owner: int) -> socket.socket:
    """The socket of the server of one process, at whose end it ends."""
    ours, theirs = socket.socketpair()
    with theirs:
        command = [sys.executable, __file__, str(theirs.fileno())]
        server = subprocess.Popen(command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, start_new_session=True)
    atexit.register(_end, ours, server)
    return ours


def _end(control: socket.socket, server: subprocess.Popen[bytes]) -> None:
    control.close()
    server.wait()


def _serve(control: socket.socket) -> None:
    """Answer requests; return in the process that is to run what one asks for."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # those that report are nobody's concern
    while True:
        asked, descriptors, *_ = socket.recv_fds(control, 1, 4)
        if not asked:
            os._exit(0)
        if not os.fork():
            control.close()
            written, told, *streams = descriptors
            with os.fdopen(written) as request:
                _report(told)
                _become(json.load(request), *streams)
            return
        for descriptor in descriptors:
            os.close(descriptor)


def _report(descriptor: int) -> None:
    """Fork: one says its child's number, and how that ended; the child returns."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    told = socket.socket(fileno=descriptor)
    child = os.fork()
    if not child:
        told.close()
        return
    with contextlib.suppress(OSError):  # it has done so itself
        os.setpgid(child, child)
    told.send(NUMBER.pack(child))
    _, status = os.waitpid(child, 0)
    with contextlib.suppress(BrokenPipeError):  # nobody wants to know
        told.send(NUMBER.pack(os.waitstatus_to_exitcode(status)))
    os._exit(0)


def _become(request: dict[str, Any], stdout: int, stderr: int) -> None:
    """Take the streams, the folder, the environment, the constants and the arguments of a request."""
    os.setpgid(0, 0)
    for ours, theirs in ((1, stdout), (2, stderr)):
        os.dup2(theirs, ours)
        os.close(theirs)
    sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", buffering=1, closefd=False)  # noqa: SIM115
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["cwd"])
    for place, value in request["constants"].items():
        module, _, name = place.rpartition(".")
        setattr(importlib.import_module(module), name, value)
    sys.argv[1:] = request["arguments"]


def main() -> None:
    """Import what commands do, and serve."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as the command line has it
    signal.signal(signal.SIGINT, signal.default_int_handler)  # also where who runs the tests ignores it, as under nohup
    for name in USED:
        importlib.import_module(name)
    _serve(socket.socket(fileno=int(sys.argv[1])))
    runpy.run_module("floatplan", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
