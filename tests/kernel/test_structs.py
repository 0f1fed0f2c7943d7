"""What crosses to C++: the layout that cffi reads in the header is the compiler's, and what does not fit is refused."""

import subprocess
import sys
from dataclasses import fields

import pytest

from floatplan.kernel import build, library
from floatplan.kernel.structs import FFI, Struct, enumeration, layout
from floatplan.kernel.tolerances import CORRECTION_OPTIONS, EXCHANGE, FINE, SETTINGS


def all_names(kind):
    """Return the names of everything of a kind that the header declares: "struct" or "enum"."""
    declared, _, _ = FFI.list_types()
    return [name for name in declared if FFI.typeof(name).kind == kind]


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


def test_every_function_of_the_header_is_exported():
    declared = [name for name in vars(library.kernel()) if not name.startswith("_")]
    exported = (build.FOLDER / "dispatch.cpp").read_text().count("\nEXPORT ")
    assert len(declared) == exported


def test_kept_declarations_are_those_of_the_header(tmp_path):
    """A module, which an installation has; where the header has changed since, it is read."""
    build.keep_declarations(tmp_path)
    module = {}
    exec((tmp_path / build.DECLARATIONS).read_text(), module)
    assert module["HEADER"] == build.header_digest()
    assert module["ffi"].sizeof("SearchProblem") == FFI.sizeof("SearchProblem")
    code = (
        "from floatplan.kernel import build; build.DECLARATIONS = 'none.py'\n"
        "from floatplan.kernel.structs import FFI; print(FFI.sizeof('SearchProblem'))"
    )
    read = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(read.stdout) == FFI.sizeof("SearchProblem")


@pytest.mark.parametrize("numbers", [FINE, SETTINGS, EXCHANGE, CORRECTION_OPTIONS], ids=lambda it: type(it).__name__)
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
