"""Options of the command line that stand for keys of problem files: the keys exist, and take what is typed."""

import pytest

from floatplan.cli.common import OPTIONS, ROBOT_OPTIONS
from floatplan.problem.file import TABLES
from floatplan.tables import OBJECTIVE_TABLE, describe_objectives

KEYS = {name: option.key for name, option in (OPTIONS | ROBOT_OPTIONS).items()}


@pytest.mark.parametrize("name", KEYS)
def test_an_option_names_a_table_or_a_key_of_the_records(name):
    key = KEYS[name]
    table, _, last = key.rpartition(".")
    if key in TABLES:
        return  # the option fills a whole table
    assert last in TABLES[table][0].keys


def test_its_numbers_are_floats_where_the_key_s_are():
    for option in OPTIONS.values():
        table, _, key = option.key.rpartition(".")
        if option.kind is float:
            assert float in (hint := TABLES[table][0].hints[key], *getattr(hint, "__args__", ()))


def test_help_and_files_describe_objectives_alike():
    described = describe_objectives()
    assert OPTIONS["objective"].help.endswith(f"{described}.")
    assert describe_objectives("`").replace("`", "") == described
    assert all(f"{name}: {row.description}" in described for name, row in OBJECTIVE_TABLE.items())
