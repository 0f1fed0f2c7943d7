"""What crosses to C++: the layout that is read from the headers is the compiler's, and what does not fit is refused."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

import floatplan as fp
from floatplan.compiled import batch
from floatplan.compiled.bodies import filled_grid
from floatplan.inflight import prediction
from floatplan.kernel import build, layout
from floatplan.kernel.layout import ENUMERATIONS, FUNCTIONS, STRUCTURES, Filled


def test_structures_and_enumerations_are_the_compiler_s(tmp_path):
    lines = ["#include <cstddef>", f'#include "{build.FOLDER / layout.HEADER}"']
    for name, kind in STRUCTURES.items():
        lines.append(f"static_assert(sizeof({name}) == {layout.ctypes.sizeof(kind)});")
        for member, *_ in kind._fields_:
            field = getattr(kind, member)
            lines.append(f"static_assert(offsetof({name}, {member}) == {field.offset});")
            lines.append(f"static_assert(sizeof({name}::{member}) == {field.size});")
    for name, enumeration in ENUMERATIONS.items():
        lines += [f"static_assert({name}({each.value}) == {name}::{each.name});" for each in enumeration]
    source = tmp_path / "layout.cpp"
    source.write_text("\n".join(lines), encoding="utf-8")
    command = [*build.command(), "-std=c++17", "-fsyntax-only", str(source)]
    assert subprocess.run(command, capture_output=True, text=True).stderr == ""
    assert sum(len(kind._fields_) for kind in STRUCTURES.values()) > 250
    assert len(FUNCTIONS) == build.FOLDER.joinpath(layout.EXPORTS).read_text().count("\nEXPORT ")


def test_pointers_know_what_they_point_to():
    known = layout.structures(
        "struct One {\n    double a, b[2];\n    const double *read;\n"
        "    Index *written;\n    Eights count;\n};\n"
        "struct Two {\n    One one;\n    One others[3];\n};\n"
    )
    assert [name for name, _ in known["One"]._fields_] == ["a", "b", "read", "written", "count"]
    assert known["One"].arrays == {"read": (np.dtype(np.float64), True), "written": (np.dtype(np.int64), False)}
    assert layout.ctypes.sizeof(known["Two"]) == 4 * 48
    with pytest.raises(KeyError, match="float"):
        layout.structures("struct One {\n    float a;\n};\n")


def test_an_address_is_numpy_s():
    whole = np.arange(24.0).reshape(4, 6)
    for values in (whole, whole[1:], whole[:, 2], whole.T, np.empty(0), np.arange(3), np.array(5.0)):
        values.flags.writeable = False
        assert layout.address(values) == values.ctypes.data


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("Grid", {"nods": 8}, "'Grid' object has no attribute 'nods'"),
        ("Settings", {"spreads_of_starts": (0.1, 0.2)}, "Settings.spreads_of_starts has 2 entries of 6"),
        ("Grid", {"nodes": 41}, "Grid.nodes is 41: it must be a multiple of 8"),
        ("Interpolation", {"nodes": 76}, "Interpolation.nodes is 76: it must be a multiple of 8"),
    ],
)
def test_what_a_structure_does_not_hold_is_refused(name, values, message):
    with pytest.raises((AttributeError, ValueError), match=message):
        STRUCTURES[name](**values)


def test_arrays_are_of_the_right_numbers_and_none_is_left_out():
    arrays = {name: np.zeros(8) for name in STRUCTURES["Grid"].arrays}
    grid = Filled("Grid", nodes=8, **arrays)
    with pytest.raises(TypeError, match=r"Grid\.tail takes a contiguous array of float64"):
        grid.point_to(tail=np.zeros(8, dtype=np.float32))
    with pytest.raises(TypeError, match=r"Grid\.tail takes a contiguous array"):
        grid.point_to(tail=np.zeros(16)[::2])
    del arrays["slope"], arrays["tail"]
    with pytest.raises(TypeError, match="Grid needs slope, tail"):
        Filled("Grid", nodes=8, **arrays)
    with pytest.raises(TypeError, match=r"Peaks\.peaks takes a contiguous array of float64"):  # no copy is written
        Filled("Peaks", **{name: np.zeros(8, dtype=np.int64) for name in STRUCTURES["Peaks"].arrays})


def test_numbers_of_nodes_that_the_kernel_cannot_take_are_refused(root, monkeypatch):
    with pytest.raises(ValueError, match="must be a multiple of 8"):
        filled_grid(3, 41)
    problem = fp.load_problem(root / "problems" / "handstand.toml")
    monkeypatch.setattr(batch, "NODE_COUNTS", (16, 24, 36, 48))
    batch._grids.cache_clear()
    with pytest.raises(ValueError, match=r"Grid\.nodes is 36: it must be a multiple of 8"):
        fp.plan(problem)
    batch._grids.cache_clear()


def test_instants_of_corrections_that_the_kernel_cannot_take_are_refused(root, monkeypatch):
    plan = fp.plan(fp.load_problem(root / "problems" / "torque_limited.toml"))
    monkeypatch.setattr(prediction, "LEAST_INSTANTS", 41)
    monkeypatch.setattr(prediction, "LANES", 1)
    with pytest.raises(ValueError, match=r"Flight\.instants is .*: it must be a multiple of 8"):
        fp.Replanner(plan)
