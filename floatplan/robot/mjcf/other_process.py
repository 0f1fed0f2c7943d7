"""MuJoCo's compiler in a process of its own, started by ``process.py``; it imports none of floatplan.

Argument: the largest memory, bytes. Requests come on standard input and responses go to where standard output was, one
after the other, until the input ends. Each is a line of JSON; after a request come the bytes that it announces.
"""

import json
import os
import resource
import sys
import warnings
from contextlib import suppress
from typing import Any, BinaryIO

import numpy as np


def compiled(mujoco: Any, request: dict[str, Any], xml: str, files: dict[str, bytes]) -> dict[str, Any]:
    """Return the arrays, names and constants that a request names, of a compiled MJCF."""
    spec = mujoco.MjSpec.from_string(xml, assets=files)
    spec.compiler.fusestatic = False
    spec.compiler.usethread = False  # each thread would take address space, which is limited here
    # Compiling ends with a step of simulation, of which nothing is used: without contacts and other constraints, so
    # that no solver runs.
    flags = mujoco.mjtDisableBit
    spec.option.disableflags |= int(flags.mjDSBL_CONSTRAINT) | int(flags.mjDSBL_CONTACT)
    spec.option.enableflags = 0
    model = spec.compile()
    arrays = {}
    for name in request["arrays"]:
        value: Any = model
        for attribute in name.split("."):
            value = getattr(value, attribute, None)
        if value is not None:  # else of another version of MuJoCo
            arrays[name] = _array(value)
    counts = {"body": model.nbody, "joint": model.njnt, "actuator": model.nu, "equality": model.neq}
    counts |= {"tendon": model.ntendon, "key": model.nkey, "mesh": model.nmesh}
    names = {}
    for kind, count in counts.items():
        names[kind] = [str(getattr(model, kind)(number).name) for number in range(count)]
    constants = {}
    for kind in request["constants"]:
        for name, member in getattr(mujoco, kind).__members__.items():
            constants[name] = int(member)
    return {"arrays": arrays, "names": names, "constants": constants}


def _array(value: Any) -> dict[str, Any]:
    array = np.asarray(value)
    kind = {"f": "float64", "b": "bool"}.get(array.dtype.kind, "int64")
    return {"dtype": kind, "shape": array.shape, "values": array.ravel().tolist()}


def next_response(mujoco: Any, stream: BinaryIO) -> dict[str, Any] | None:
    """Return the response to the next request; None where there is none any more."""
    line = stream.readline()
    if not line:
        return None
    request = json.loads(line)
    xml = stream.read(request["xml"]).decode()
    files = {name: stream.read(size) for name, size in request["files"].items()}
    used = resource.getrusage(resource.RUSAGE_SELF)
    used_seconds = used.ru_utime + used.ru_stime
    # 2 s more than the request, for work that does not belong to it
    bound(resource.RLIMIT_CPU, int(used_seconds + request["seconds"]) + 2)
    try:
        return compiled(mujoco, request, xml, files)
    except MemoryError:
        return {"error": "it takes too much memory"}
    except Exception as error:  # of several kinds, its own among them
        return {"error": str(error) or type(error).__name__}


def bound(limit: int, most: int) -> None:
    """Set a limit of this process, as far as the system lets it."""
    hard = resource.getrlimit(limit)[1]
    if hard != resource.RLIM_INFINITY:
        most = min(most, hard)
    with suppress(OSError, ValueError):  # macOS knows no limit of address space
        resource.setrlimit(limit, (most, hard))


def main() -> None:
    """Respond to requests, or say that MuJoCo is not there."""
    memory = int(sys.argv[1])
    with os.fdopen(os.dup(1), "wb") as output:
        os.dup2(2, 1)  # whatever MuJoCo prints is no response
        try:
            import mujoco
        except ImportError as error:
            output.write(json.dumps({"missing": str(error)}).encode() + b"\n")
            return
        mujoco.set_mju_user_warning(lambda _: None)  # else it writes a log
        warnings.simplefilter("ignore")  # about what newer versions will no longer read
        bound(resource.RLIMIT_AS, memory)
        bound(resource.RLIMIT_FSIZE, 0)  # it writes no file at all
        while (response := next_response(mujoco, sys.stdin.buffer)) is not None:
            output.write(json.dumps(response).encode() + b"\n")
            output.flush()


if __name__ == "__main__":
    main()
