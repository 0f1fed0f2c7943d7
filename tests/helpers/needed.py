"""What a test needs and may be missing: a reason to skip on a desk, a failure in continuous integration."""

import os
from typing import NoReturn

import pytest


def skip_or_fail(reason: str) -> NoReturn:
    """Skip the test, or fail it where CI is set: what is to be there must not be left out without a word."""
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason, allow_module_level=True)
