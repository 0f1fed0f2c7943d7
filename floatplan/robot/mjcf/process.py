"""The process in which MuJoCo compiles: with bounds on time and memory, and stopped by Ctrl-C here.

It is started for the first MJCF and compiles all later ones, so that MuJoCo is imported once. It ends with this
process, and is killed where it does not respond in time.
"""

import atexit
import json
import os
import selectors
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from floatplan.errors import InputError
from floatplan.pool import same_modules

LONGEST = 60.0  # [s] of one file; robots with a hundred meshes take seconds
MEMORY = 2_000_000_000  # [bytes] of address space: 0.15e9 for MuJoCo itself, and what meshes need
LARGEST_RESPONSE = 50_000_000  # [bytes]; of a thousand bodies it is a megabyte


class CompilerProcess:
    """A process that compiles one MJCF after the other."""

    def __init__(self) -> None:
        with same_modules():
            script = Path(__file__).with_name("other_process.py")
            self._process = subprocess.Popen(
                [sys.executable, str(script), str(MEMORY)],
                cwd=tempfile.gettempdir(),
                env={**os.environ, "MUJOCO_GL": "disable"},  # it shows nothing, and a library of windows loads slowly
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for this process, which ends the other
            )
        self.owner = os.getpid()  # a process that is forked off has pipes of its parent's

    def ask(self, request: Mapping[str, Any], xml: bytes, files: Mapping[str, bytes]) -> dict[str, Any]:
        """Return the response to a request; see ``other_process.py``.

        Raises
        ------
        InputError
            There is none in time, or the process died.
        """
        sizes = {"xml": len(xml), "files": {name: len(content) for name, content in files.items()}}
        line = json.dumps({**request, **sizes, "seconds": LONGEST}).encode() + b"\n"
        try:
            return self._response([line, xml, *files.values()], time.monotonic() + LONGEST)
        except BaseException:  # also Ctrl-C: nobody needs the result of its work any more
            self.end()
            raise

    def _response(self, contents: list[bytes], deadline: float) -> dict[str, Any]:
        stdin = self._process.stdin
        stdout = self._process.stdout
        if stdin is None or stdout is None:
            raise RuntimeError("the process was started without pipes")
        try:
            for content_to_send in contents:
                stdin.write(content_to_send)
            stdin.flush()
        except BrokenPipeError:
            raise self._unexpected_end() from None
        content = bytearray()
        with selectors.DefaultSelector() as selector:
            selector.register(stdout, selectors.EVENT_READ)
            while not content.endswith(b"\n"):
                if not selector.select(max(0.0, deadline - time.monotonic())):
                    raise InputError(f"MuJoCo takes more than {LONGEST:g} s to compile it")
                chunk = os.read(stdout.fileno(), 1 << 20)  # [bytes] at once
                if not chunk:
                    raise self._unexpected_end()
                content += chunk
                if len(content) > LARGEST_RESPONSE:
                    raise InputError(f"makes a model of more than {LARGEST_RESPONSE // 1_000_000} MB, as no robot is")
        response: dict[str, Any] = json.loads(content)
        return response

    def _unexpected_end(self) -> InputError:
        self.end()
        code = self._process.returncode
        advice = f"it may need more than {MEMORY / 1e9:g} GB, or {LONGEST:g} s of processor time"
        return InputError(f"MuJoCo ended with code {code} while it compiled this", advice=advice)

    def end(self) -> None:
        """End the process now."""
        with suppress(ProcessLookupError):
            self._process.kill()
        self._process.wait()
        self.let_go()

    def let_go(self) -> None:
        """Close this process's ends of the pipes."""
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    @property
    def usable(self) -> bool:
        """Whether this process can use it."""
        return self.owner == os.getpid() and self._process.poll() is None


_lock = threading.Lock()
_process: CompilerProcess | None = None


@atexit.register
def _end() -> None:
    """End the process with this one, unless it is that of the one that this was forked from."""
    if _process is not None and _process.owner == os.getpid():
        _process.end()


def compiler_response(request: Mapping[str, Any], xml: bytes, files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the response of the compiler's process, started where there is none; errors as of its ``ask``."""
    global _process
    with _lock:
        if _process is not None and not _process.usable:
            _process.let_go()
            _process = None
        if _process is None:
            _process = CompilerProcess()
        return _process.ask(request, xml, files)
