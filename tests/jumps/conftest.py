import pytest
from jumps import INSTALLED
from needed import skip_or_fail


@pytest.fixture(scope="session", autouse=True)
def installed():
    """What jumps need."""
    if not INSTALLED:
        skip_or_fail("CasADi or example-robot-data is not installed")
