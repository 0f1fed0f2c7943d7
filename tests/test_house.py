"""How large files, folders and functions may be: figures that may fall, and rise only where someone decides it."""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

import floatplan

PACKAGE = Path(floatplan.__file__).parent
SOURCE = {".py", ".pyi", ".cpp", ".hpp", ".h", ".js", ".css", ".html", ".toml", ".txt"}
MOST_LINES_OF_A_FILE = 600  # a wall against files of several topics, not a budget: lines are free
MOST_FILES_OF_A_FOLDER = 20
MOST_FILES_OF_THE_PACKAGE = 8  # directly in it
MOST_LINES_OF_A_FUNCTION = 60  # its docstring not counted
MOST_PARAMETERS = 9  # of a public call, whose options are keywords

FILES = sorted(
    path
    for path in PACKAGE.rglob("*")
    if path.suffix in SOURCE and not {"uplot", "__pycache__"} & set(path.relative_to(PACKAGE).parts)
)
MODULES = [path for path in FILES if path.suffix == ".py"]


def lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


@cache
def functions() -> list[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """All functions but commands of the command line, whose parameters are its options."""
    found = []
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                if path.parent.name == "cli" and "Annotated[" in ast.unparse(node.args):
                    continue
                found.append((f"{path.relative_to(PACKAGE)}: {node.name}", node))
    return found


def length(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    assert function.end_lineno is not None
    docstring = function.body[0] if ast.get_docstring(function) is not None else None
    own = 0 if docstring is None or docstring.end_lineno is None else docstring.end_lineno - docstring.lineno + 1
    return function.end_lineno - function.lineno + 1 - own


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    given = function.args
    named = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return len(named) - (named[:1] in (["self"], ["cls"]))


def test_no_file_is_too_long() -> None:
    assert {str(path.relative_to(PACKAGE)) for path in MODULES if lines(path) > MOST_LINES_OF_A_FILE} == set()


def test_no_folder_is_too_full() -> None:
    files = Counter(path.parent for path in MODULES)
    assert {str(folder): count for folder, count in files.items() if count > MOST_FILES_OF_A_FOLDER} == {}
    assert files[PACKAGE] <= MOST_FILES_OF_THE_PACKAGE


@pytest.mark.parametrize(("measure", "most"), [(length, MOST_LINES_OF_A_FUNCTION), (parameters, MOST_PARAMETERS)])
def test_no_function_is_too_large(measure, most) -> None:
    assert {name: measure(function) for name, function in functions() if measure(function) > most} == {}
