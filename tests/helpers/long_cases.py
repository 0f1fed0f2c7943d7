"""Cases of which some are run every time, others with ``scripts/check --all``."""

from collections.abc import Container, Iterable
from typing import Any

import pytest


def cases(every: Iterable[Any], long: Container[Any]) -> list[Any]:
    """Return ``every`` case for ``parametrize``, those in ``long`` marked."""
    return [pytest.param(case, marks=pytest.mark.long) if case in long else case for case in every]
