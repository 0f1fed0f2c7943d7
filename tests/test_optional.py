"""What is asked for and not installed is said, with how to get it."""

from __future__ import annotations

import math
import sys

import pytest

from floatplan.errors import InputError
from floatplan.optional import import_optional


def test_a_module_that_is_there_is_returned() -> None:
    assert import_optional("math", name="maths", element="engine", install="maths") is math


def test_one_that_is_not_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError) as refused:
        import_optional("viser", name="viser", element="scene", install='"floatplan[view]"')
    assert str(refused.value) == 'scene: viser is not installed; install it: pip install "floatplan[view]"'
