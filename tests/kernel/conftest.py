import pytest

from floatplan.kernel import library


@pytest.fixture
def kernel():
    return library.kernel()
