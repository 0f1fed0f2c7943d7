"""What other packages say of a robot, asked in a process of its own by ``packages.py``; it imports none of floatplan.

Arguments: what is asked, of what, and the largest memory, bytes. The answer is written to where standard output was, or
why there is none, with an exit code of 1.
"""

import json
import os
import resource
import sys
from importlib import import_module

PATHS = ("URDF_PATH", "XACRO_PATH", "MJCF_PATH")
LONGEST = 100_000_000  # [bytes] of the answer


def expanded(file: str) -> bytes:
    """Return the URDF that a xacro file makes; ``package://`` stays, so that it is the same on every machine."""
    document = import_module("xacrodoc").XacroDoc.from_file(file, resolve_packages=False)
    content: bytes = document.dom.toxml(encoding="utf-8")
    return content


def described(name: str) -> bytes:
    """Return the paths that a module of robot_descriptions gives."""
    module = import_module(f"robot_descriptions.{name}")
    return json.dumps({key: str(getattr(module, key)) for key in PATHS if hasattr(module, key)}).encode()


if __name__ == "__main__":
    _, asked, subject, memory = sys.argv
    for limit, most in ((resource.RLIMIT_AS, int(memory)), (resource.RLIMIT_FSIZE, LONGEST)):
        resource.setrlimit(limit, (most, most))
    answer = os.dup(1)
    code = 0
    os.dup2(2, 1)  # whatever is printed meanwhile is no answer
    try:
        content = {"xacro": expanded, "description": described}[asked](subject)
    except BaseException as error:
        cause = getattr(error, "exc", None) or error  # of xacro's own
        content = f"{type(cause).__name__}: {error}".encode("utf-8", "replace")
        code = 1
    with os.fdopen(answer, "wb") as stream:
        stream.write(content)
    sys.exit(code)
