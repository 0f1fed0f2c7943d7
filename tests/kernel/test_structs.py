"""What crosses to C++: the layout that cffi reads in the header is the compiler's, and what does not fit is refused."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from dataclasses import asdict, fields

import numpy as np
import pytest

import floatplan as fp
from floatplan.inflight import prediction
from floatplan.kernel import build, library
from floatplan.kernel.structs import FFI, Struct, StructArray, enumeration, layout
from floatplan.kernel.tolerances import CORRECTION_GAINS, EXCHANGE, FINE, SETTINGS
from floatplan.planning import batch
from floatplan.planning.kernel_input import rows


def all_names(kind: str) -> list[str]:
    """Return the names of everything of a kind that the header declares: "struct" or "enum"."""
    declared, _, _ = FFI.list_types()
    return [name for name in declared if FFI.typeof(name).kind == kind]


def node_arrays() -> dict[str, np.ndarray]:
    return {name: np.arange(8.0) + index for index, name in enumerate(layout("Nodes").arrays)}


def test_structs_and_enumerations_are_the_compiler_s(tmp_path):
    lines = ["#include <cstddef>", 'extern "C" {', f'#include "{build.FOLDER / build.HEADER}"', "}"]
    members = 0
    for name in all_names("struct"):
        record = layout(name).record
        lines.append(f"static_assert(sizeof({name}) == {record.itemsize});")
        for member, (kind, offset, *_) in record.fields.items():
            lines.append(f"static_assert(offsetof({name}, {member}) == {offset});")
            lines.append(f"static_assert(sizeof({name}::{member}) == {kind.itemsize});")
            members += 1
    for name in all_names("enum"):
        lines += [f"static_assert({name}({each.value}) == {name}::{each.name});" for each in enumeration(name)]
    source = tmp_path / "structs.cpp"
    source.write_text("\n".join(lines), encoding="utf-8")
    command = [*build.command(), "-std=c++17", "-fsyntax-only", str(source)]
    assert subprocess.run(command, capture_output=True, text=True).stderr == ""
    assert members > 250


def test_the_header_is_plain_c(tmp_path):
    source = tmp_path / "structs.c"
    source.write_text(f'#include "{build.FOLDER / build.HEADER}"\n', encoding="utf-8")
    command = [*build.command(), "-x", "c", "-std=c99", "-Wall", "-Werror", "-fsyntax-only", str(source)]
    assert subprocess.run(command, capture_output=True, text=True).stderr == ""


def test_every_function_of_the_header_is_exported():
    declared = [name for name in vars(library.kernel()) if not name.startswith("_")]
    exported = (build.FOLDER / "dispatch.cpp").read_text().count("\nEXPORT ")
    assert len(declared) == exported


def test_kept_declarations_are_those_of_the_header(tmp_path):
    """A module, which an installation has; where the header has changed since, it is read."""
    build.keep_declarations(tmp_path)
    module: dict[str, object] = {}
    exec((tmp_path / build.DECLARATIONS).read_text(), module)
    assert module["HEADER"] == build.header_digest()
    assert module["ffi"].sizeof("SearchProblem") == FFI.sizeof("SearchProblem")
    code = (
        "from floatplan.kernel import build; build.DECLARATIONS = 'none.py'\n"
        "from floatplan.kernel.structs import FFI; print(FFI.sizeof('SearchProblem'))"
    )
    read = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(read.stdout) == FFI.sizeof("SearchProblem")


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("Nodes", {"nods": 8, **node_arrays()}, "Nodes has no nods"),
        (
            "Settings",
            {**asdict(SETTINGS), "spreads_of_starts": (0.1,)},
            "Settings.spreads_of_starts has 1 entries of 6",
        ),
        ("Nodes", {"nodes": 41, **node_arrays()}, "Nodes.nodes is 41: it must be a multiple of 8"),
        ("Stage", {"feasibility": 1e-9, "iterations": 3}, "Stage needs optimality, quadrature_error"),
        (
            "Nodes",
            {"nodes": 8, **dict.fromkeys(("s", "weights", "value", "first", "second", "integrals"))},
            "Nodes needs antiderivative, tail",
        ),
        ("Peaks", {"count": 1}, "Peaks needs .*, minima,"),
    ],
)
def test_what_a_struct_does_not_hold_is_refused(name, values, message):
    with pytest.raises((TypeError, ValueError), match=message):
        Struct(name, **values)


@pytest.mark.parametrize(
    "array", [np.zeros(8, np.float32), np.zeros(8, np.int64), np.zeros(16)[::2], np.zeros((4, 2)).T, [0.0] * 8, 0.0]
)
def test_arrays_are_contiguous_and_of_the_right_numbers(array):
    with pytest.raises(TypeError, match=r"Nodes\.tail takes a(n| contiguous) array of float64"):
        Struct("Nodes", nodes=8, **{**node_arrays(), "tail": array})
    grid = Struct("Nodes", nodes=8, **node_arrays())
    with pytest.raises(TypeError, match=r"Nodes\.tail takes a(n| contiguous) array of float64"):
        grid.point_to(tail=array)
    with pytest.raises(TypeError, match="Nodes points to no head"):
        grid.point_to(head=np.zeros(8))


def test_arrays_live_as_long_as_what_points_to_them():
    grid = Struct("Nodes", nodes=8, **node_arrays())
    minima = Struct("Minima", grid=None, low=None, high=None, row=np.arange(3), s=np.arange(3.0), least=None)
    outer = Struct("Peaks", **{**dict.fromkeys(layout("Peaks").required), "minima": minima})
    several = StructArray([grid, grid])
    del minima
    for _ in range(100):
        np.full(8, np.nan)
    assert [grid.pointer.tail[k] for k in range(8)] == [2.0 + k for k in range(8)]
    assert outer.pointer.minima.s[2] == 2.0
    assert several.pointer[1].tail[1] == 3.0


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy, lambda it: pickle.loads(pickle.dumps(it))])
def test_copies_hold_the_same_and_have_arrays_of_their_own(copied):
    row, s = np.arange(3), np.arange(3.0)
    minima = Struct("Minima", instants=4, grid=None, low=None, high=None, row=row, s=s, least=None)
    outer = Struct("Peaks", count=2, **{**dict.fromkeys(layout("Peaks").required), "minima": minima, "peaks": s})
    outer.pointer.minima.found = 7
    other = copied(outer)
    assert (other.pointer.count, other.pointer.minima.instants, other.pointer.minima.found) == (2, 4, 7)
    assert other.pointer.minima.row[2] == 2
    assert other.pointer.low == FFI.NULL
    other.pointer.count = 5
    assert outer.pointer.count == 2
    other.point_to(peaks=np.full(3, 7.0))
    assert outer.pointer.peaks[1] == 1.0
    assert outer._arrays["peaks"] is s
    if copied is not copy.copy:
        other.pointer.minima.s[1] = 9.0
        assert s[1] == 1.0


def test_rows_differ_in_numbers_and_arrays():
    like = Struct("Nodes", nodes=8, **node_arrays())
    rows = StructArray([like], 3)
    own = np.arange(24.0).reshape(3, 8)
    rows.give(tail=own, nodes=[8, 16, 24])
    assert [rows.pointer[k].nodes for k in range(3)] == [8, 16, 24]
    assert [rows.pointer[k].tail[1] for k in range(3)] == [1.0, 9.0, 17.0]
    assert rows.pointer[2].value[0] == like.pointer.value[0]
    with pytest.raises(TypeError, match=r"Nodes\.tail takes a contiguous array"):
        rows.give(tail=np.zeros((8, 3)).T)


@pytest.mark.parametrize("numbers", [FINE, SETTINGS, EXCHANGE, CORRECTION_GAINS], ids=lambda it: type(it).__name__)
def test_tolerances_are_those_of_the_structs(numbers):
    name = type(numbers).__name__
    assert [field.name for field in fields(numbers)] == list(layout(name).record.names)
    struct = Struct.of_numbers(numbers)
    for field in fields(numbers):
        value, crossed = getattr(numbers, field.name), getattr(struct.pointer, field.name)
        if field.name == "stages":
            assert [stage.feasibility for stage in value] == [crossed[k].feasibility for k in range(3)]
        else:
            assert value == (tuple(crossed) if isinstance(value, tuple) else crossed)


def test_tolerances_belong_together():
    assert EXCHANGE.tight == 10 * EXCHANGE.back_off


def test_numbers_of_nodes_that_the_kernel_cannot_take_are_refused(root, monkeypatch):
    with pytest.raises(ValueError, match="must be a multiple of 8"):
        Struct("Nodes", nodes=41, **node_arrays())
    problem = fp.load_problem(root / "problems" / "handstand.toml")
    monkeypatch.setattr(rows, "NODE_COUNTS", (16, 24, 36, 48))
    rows.nodes_of_levels.cache_clear()
    batch._template.cache_clear()
    with pytest.raises(ValueError, match=r"Nodes\.nodes is 36: it must be a multiple of 8"):
        fp.plan(problem)
    rows.nodes_of_levels.cache_clear()


def test_instants_of_corrections_that_the_kernel_cannot_take_are_refused(root, monkeypatch):
    plan = fp.plan(fp.load_problem(root / "problems" / "torque_limited.toml"))
    monkeypatch.setattr(prediction, "LEAST_INSTANTS", 41)
    monkeypatch.setattr(prediction, "LANES", 1)
    with pytest.raises(ValueError, match=r"Flight\.instants is .*: it must be a multiple of 8"):
        fp.Replanner(plan)
