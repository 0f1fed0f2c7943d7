"""ProxQP as built for the instructions that every processor has.

Its builds for AVX add up in an order that depends on where memory happens to lie, so that the last digit differs
from call to call, and with it, in the end, the solution. For small QPs they are no faster. Where something else has
imported ProxSuite before, it stays as it is: two builds in one process crash it.
"""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any


def _reproducible_proxqp() -> Any:
    if "proxsuite" not in sys.modules:
        checks = "proxsuite.instructionset"
        sys.modules[checks] = SimpleNamespace(has_AVX512F=lambda: False, has_AVX2=lambda: False)  # type: ignore[assignment]
        try:
            import proxsuite
        finally:
            del sys.modules[checks]
    import proxsuite

    return proxsuite.proxqp


proxqp = _reproducible_proxqp()
