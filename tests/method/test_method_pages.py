"""The reference method as it is shown: the theory's page quotes it, and it stays short."""

from __future__ import annotations

import re
import sys
from functools import reduce
from importlib import import_module
from pathlib import Path

import floatplan as fp

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "theory" / "method.md"
MODULES = sorted((ROOT / "floatplan" / "method").glob("*.py"))
MOST_LINES = 450  # with docstrings and blank ones


def module_of(path: Path) -> str:
    return "floatplan.method" if path.stem == "__init__" else f"floatplan.method.{path.stem}"


def test_the_theory_page_quotes_what_is_there() -> None:
    page = PAGE.read_text(encoding="utf-8")
    quoted = re.findall(r"^```\{literalinclude\} (\S+)\n:pyobject: (\S+)$", page, re.MULTILINE)
    assert len(set(quoted)) == len(quoted) == page.count("literalinclude") > 8
    for source, name in quoted:
        path = (PAGE.parent / source).resolve()
        assert path in MODULES
        assert callable(reduce(getattr, name.split("."), import_module(module_of(path)))), name


def test_every_function_of_the_table_is_there() -> None:
    rows = re.findall(r"^\| (?:[^|]*\(\S+\)[^|]*) \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    names = [name for row in rows for name in re.findall(r"`([\w.]+)`", row)]
    assert len(names) > 8
    modules = [import_module(module_of(path)) for path in MODULES]
    for name in names:
        first, *_ = name.split(".")
        (home,) = (
            module for module in modules if getattr(vars(module).get(first), "__module__", "") == module.__name__
        )
        assert callable(reduce(getattr, name.split("."), home)), name


def test_it_stays_short() -> None:
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES) <= MOST_LINES


def test_it_is_public() -> None:
    assert "method" in fp.__all__
    assert fp.method is sys.modules["floatplan.method"]
