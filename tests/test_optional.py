"""What is asked for and not installed is said, with how to get it."""

import math
import shlex
import sys
from pathlib import Path

import pytest

from floatplan import errors
from floatplan.errors import InputError, import_optional


def test_a_module_that_is_there_is_returned():
    assert import_optional("math", name="maths", element="engine", extra="maths") is math


def refusal(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError) as refused:
        import_optional("viser", name="viser", element="scene", extra="view")
    return str(refused.value)


def test_from_a_clone_the_command_installs_the_clone(monkeypatch, tmp_path):
    (tmp_path / "pyproject.toml").touch()
    monkeypatch.setattr(errors, "PACKAGE", tmp_path / "floatplan")
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv" / "bin" / "python"))
    monkeypatch.chdir(tmp_path)
    start = 'scene: viser is not installed: it comes with the extra "view"; install it: '
    assert refusal(monkeypatch) == f"{start}.venv/bin/python -m pip install -e '.[view]'"
    monkeypatch.chdir(tmp_path.parent)
    near = tmp_path.name
    assert refusal(monkeypatch) == f"{start}{near}/.venv/bin/python -m pip install -e '{near}[view]'"
    monkeypatch.chdir("/")
    words = shlex.split(errors.install_advice("view").partition("install it: ")[2])
    assert (Path("/") / words[0]).resolve() == (tmp_path / ".venv" / "bin" / "python").resolve()
    assert words[1:5] == ["-m", "pip", "install", "-e"]


def test_from_a_wheel_it_installs_the_package(monkeypatch, tmp_path):
    monkeypatch.setattr(errors, "PACKAGE", tmp_path / "floatplan")
    monkeypatch.chdir(tmp_path)
    assert refusal(monkeypatch).endswith(f"install it: {shlex.quote(sys.executable)} -m pip install 'floatplan[view]'")
