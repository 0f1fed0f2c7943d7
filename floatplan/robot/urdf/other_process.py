"""Robots of other packages, in a process of its own that ``packages.py`` starts; it imports none of floatplan.

Arguments: the kind of robot, its name, and the largest memory, bytes. The result is written to where standard output
was, or the reason why there is none, with an exit code of 1.
"""

import json
import os
import resource
import sys
from importlib import import_module


def expanded(file: str) -> bytes:
    """Return the URDF that a xacro file makes; ``package://`` stays, so that it is the same on every machine."""
    document = import_module("xacrodoc").XacroDoc.from_file(file, resolve_packages=False)
    content: bytes = document.dom.toxml(encoding="utf-8")
    return content


def described(name: str) -> bytes:
    """Return the paths that a module of robot_descriptions gives."""
    module = import_module(f"robot_descriptions.{name}")
    paths = {}
    for key in ("URDF_PATH", "XACRO_PATH", "MJCF_PATH"):
        if hasattr(module, key):
            paths[key] = str(getattr(module, key))
    return json.dumps(paths).encode()


if __name__ == "__main__":
    _, kind, subject, memory = sys.argv
    largest_output = 100_000_000  # [bytes]
    for limit, most in ((resource.RLIMIT_AS, int(memory)), (resource.RLIMIT_FSIZE, largest_output)):
        resource.setrlimit(limit, (most, most))
    output = os.dup(1)
    code = 0
    os.dup2(2, 1)  # whatever is printed meanwhile does not belong to the result
    try:
        content = {"xacro": expanded, "description": described}[kind](subject)
    except BaseException as error:
        cause = getattr(error, "exc", None) or error  # of xacro's own
        content = f"{type(cause).__name__}: {error}".encode("utf-8", "replace")
        code = 1
    with os.fdopen(output, "wb") as stream:
        stream.write(content)
    sys.exit(code)
