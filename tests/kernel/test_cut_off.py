"""A compiled kernel that ends too early, as after a full disk: it is not loaded, and commands say so."""

import os
import subprocess
import sys

from places import ROOT

SHARES = (0.0, 1e-4, 0.01, 0.3, 0.9, 0.9999)
LOADING = """
import pathlib, sys
from floatplan.kernel import library
whole = pathlib.Path(library.FOLDER, library.LIBRARY).read_bytes()
for number, share in enumerate(sys.argv[1:]):
    library.FOLDER = pathlib.Path(str(number))
    library.FOLDER.mkdir()
    (library.FOLDER / library.LIBRARY).write_bytes(whole[: int(float(share) * len(whole))])
    try:
        print(type(library.kernel.__wrapped__()).__name__)
    except library.InstallationError:
        print(None)
"""


def test_it_is_not_loaded(tmp_path):
    """In a process of its own, which the system would kill."""
    command = [sys.executable, "-c", LOADING, *map(str, (*SHARES, 1.0))]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    *cut_off, whole = run.stdout.splitlines()
    assert cut_off == ["None"] * len(SHARES)
    assert "Kernel" in whole
