"""The process in which MuJoCo compiles: with bounds on time and memory, and ended by Ctrl-C here.

It is started for the first MJCF and answers all later ones, so that MuJoCo is imported once. It ends with this process,
and is ended where it does not answer in time.
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
MEMORY = 2_000_000_000  # [bytes] of address space; MuJoCo itself takes 0.15e9, what meshes need comes on top
LARGEST_ANSWER = 50_000_000  # [bytes]; of a thousand bodies it is a megabyte
SCRIPT = Path(__file__).with_name("other_process.py")
CHUNK = 1 << 20  # [bytes] read at once


class CompilerProcess:
    """A process that compiles one MJCF after the other."""

    def __init__(self) -> None:
        with same_modules():
            self._process = subprocess.Popen(
                [sys.executable, str(SCRIPT), str(MEMORY)],
                cwd=tempfile.gettempdir(),
                env={**os.environ, "MUJOCO_GL": "disable"},  # it draws nothing, and a library of windows loads slowly
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C is for this process, which ends the other
            )
        self.owner = os.getpid()  # a process that is forked off has pipes of its parent's

    def ask(self, request: Mapping[str, Any], xml: bytes, files: Mapping[str, bytes]) -> dict[str, Any]:
        """Return the answer to a request; see ``other_process.py``.

        Raises
        ------
        InputError
            There is none in time, or the process ended.
        """
        sizes = {"xml": len(xml), "files": {name: len(content) for name, content in files.items()}}
        line = json.dumps({**request, **sizes, "seconds": LONGEST}).encode() + b"\n"
        try:
            return self._exchanged([line, xml, *files.values()], time.monotonic() + LONGEST)
        except BaseException:  # also Ctrl-C: what it is at is of no use any more
            self.end()
            raise

    def _exchanged(self, parts: list[bytes], deadline: float) -> dict[str, Any]:
        stdin = self._process.stdin
        stdout = self._process.stdout
        if stdin is None or stdout is None:
            raise RuntimeError("the process was started without pipes")
        try:
            for part in parts:
                stdin.write(part)
            stdin.flush()
        except BrokenPipeError:
            raise self._ended() from None
        content = bytearray()
        with selectors.DefaultSelector() as selector:
            selector.register(stdout, selectors.EVENT_READ)
            while not content.endswith(b"\n"):
                if not selector.select(max(0.0, deadline - time.monotonic())):
                    raise InputError(f"MuJoCo takes more than {LONGEST:g} s to compile it")
                chunk = os.read(stdout.fileno(), CHUNK)
                if not chunk:
                    raise self._ended()
                content += chunk
                if len(content) > LARGEST_ANSWER:
                    raise InputError(f"makes a model of more than {LARGEST_ANSWER // 1_000_000} MB, as no robot is")
        answer: dict[str, Any] = json.loads(content)
        return answer

    def _ended(self) -> InputError:
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
        """Whether it can be asked from this process."""
        return self.owner == os.getpid() and self._process.poll() is None


_lock = threading.Lock()
_process: CompilerProcess | None = None


@atexit.register
def _end() -> None:
    """End the process with this one, unless it is that of the one that this was forked from."""
    if _process is not None and _process.owner == os.getpid():
        _process.end()


def compiler_answer(request: Mapping[str, Any], xml: bytes, files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return what the one process of this one answers, started where there is none; errors as of its ``ask``."""
    global _process
    with _lock:
        if _process is not None and not _process.usable:
            _process.let_go()
            _process = None
        if _process is None:
            _process = CompilerProcess()
        return _process.ask(request, xml, files)
