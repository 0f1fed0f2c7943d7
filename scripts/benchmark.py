"""Measures floatplan, and its peers beside it; the modules are in ``benchmarks/``. ``--help`` names the sections."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from sections import main

if __name__ == "__main__":
    main()
