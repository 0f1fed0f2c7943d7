"""Options of the command line that stand for keys of files: one row describes both, and one function its default."""

import inspect
from typing import Literal, get_args, get_origin

import pytest

import floatplan as fp
from floatplan.cli import clips, commands, motions
from floatplan.cli.common import OPTIONS, ROBOT_OPTIONS
from floatplan.clips.repair import repair_clip
from floatplan.clips.repaired_flight import CLIP_WEIGHTS
from floatplan.keys import in_files
from floatplan.problem.file import TABLES, problem_schema
from floatplan.studies.schema import ResultTable
from floatplan.tables import CHOICES, KEY_TABLE, OBJECTIVE_TABLE, Engine, RepairName, StanceMethod, describe_objectives

KEYS = {name: option.key for name, option in (OPTIONS | ROBOT_OPTIONS).items()}
RECORDS = {place: record for place, (record, _) in TABLES.items()} | {"result": ResultTable}


def record_of(path):
    """The record that has the key at a path, and the name of its field."""
    place, _, key = path.rpartition(".")
    (name,) = [name for name in RECORDS[place].keys if in_files(name) == key]
    return RECORDS[place], name


@pytest.mark.parametrize("path", KEY_TABLE)
def test_the_record_of_a_key_takes_its_row(path):
    row = KEY_TABLE[path]
    record, name = record_of(path)
    key = record.keys[name]
    assert key.meaning == row.meaning or key.meaning.startswith(f"{row.meaning}. ")
    assert key.meaning.count(row.meaning) == 1
    assert (key.unit, key.numbers) == (row.unit, row.numbers)
    if row.default is not None:
        assert record.__dataclass_fields__[name].default == row.default


@pytest.mark.parametrize("name", KEYS)
def test_an_option_stands_for_a_key_that_has_a_row(name):
    assert KEYS[name] in KEY_TABLE


def words_of(hint):
    """The words of all literals in a type."""
    if get_origin(hint) is Literal:
        return set(get_args(hint))
    return set().union(*map(words_of, get_args(hint)))


def test_help_names_every_word_that_the_type_of_a_key_has():
    words = {}
    for name, option in (OPTIONS | ROBOT_OPTIONS).items():
        if option.key not in TABLES:  # whose option fills a table
            record, key = record_of(option.key)
            words[name] = words_of(record.hints[key])
            assert [word for word in words[name] if word not in option.help] == []
    assert words["start_velocities"] == {"takeoff", "landing"}
    assert words["coupled"] == {"mirror"}


def test_docstrings_have_the_rows_and_what_is_of_files():
    text = " ".join(fp.Motion.__doc__.split())
    degree = KEY_TABLE["motion.degree"].meaning
    assert f'degree : int, (n,) ints, or "auto" {degree}. It is k_i of (12);' in text
    assert text.count(degree) == 1
    assert fp.JumpLanding.keys["contacts"] == fp.JumpTakeoff.keys["contacts"]


def test_its_numbers_are_floats_where_the_key_s_are():
    for option in OPTIONS.values():
        table, _, key = option.key.rpartition(".")
        if option.kind is float:
            assert float in (hint := TABLES[table][0].hints[key], *getattr(hint, "__args__", ()))


@pytest.mark.parametrize(
    ("command", "keys"),
    {
        "plan": [*KEYS.values(), "angles"],
        "init": [
            *(option.key for option in ROBOT_OPTIONS.values()),
            *("angles", "flight.takeoff.frame", "flight.landing.frame", "flight.duration"),
            *("jump.takeoff.contacts", "jump.landing.contacts", "jump.takeoff.from"),
        ],
        "launch": ["jump.friction"],
        "replay": ["jump.friction"],
        "bench": ["jump.friction"],
        "study": ["result.folder"],
        "study merge": ["result.folder"],
    }.items(),
)
def test_help_says_what_files_say(command, keys, floatplan):
    text = "".join(floatplan(*command.split(), "--help").stdout.split())
    for key in keys:
        assert "".join(KEY_TABLE[key].meaning.replace("`", "").split()) in text


def test_help_has_units_bounds_and_defaults(floatplan):
    text = " ".join(floatplan("plan", "--help").stdout.split())
    assert "[5 to 15; left out: the file's, else 7]" in text
    assert "[0.001 to 1000 s]" in text
    assert "[kg m^2/s; left out: the file's, else midpoint]" in text


def test_help_and_files_describe_objectives_alike():
    described = describe_objectives()
    assert described in OPTIONS["objective"].help
    assert describe_objectives("`").replace("`", "") == described
    assert all(f"{name}: {row.description}" in described for name, row in OBJECTIVE_TABLE.items())


def test_schemas_have_the_bounds_of_rows():
    whole_number, *_ = problem_schema()["$defs"]["MotionTable"]["properties"]["degree"]["anyOf"]
    assert whole_number == {"type": "integer", "minimum": 5, "maximum": 15}


def test_types_name_the_choices():
    assert get_args(Engine) == tuple(CHOICES["simulator"])
    assert get_args(StanceMethod) == tuple(CHOICES["stances"])
    assert get_args(RepairName) == tuple(CHOICES["repair"])
    assert {*CLIP_WEIGHTS, "auto"} == CHOICES["repair"].keys()


@pytest.mark.parametrize(
    ("arguments", "choices"),
    [
        (["plan", "problem.toml", "--method"], "method"),
        (["replay", "plan.json", "--engine"], "simulator"),
    ],
)
def test_a_wrong_choice_is_answered_with_all_of_them(arguments, choices, floatplan):
    run = floatplan(*arguments, "nonsense")
    assert (run.code, run.stdout) == (2, "")
    listed = " or ".join(map(repr, CHOICES[choices]))
    assert f"must be {listed}, not 'nonsense'" in run.stderr


@pytest.mark.parametrize(
    ("command", "function", "names"),
    [
        (commands.plan, fp.plan, ("seed", "starts", "budget")),
        (commands.jump, fp.jump, ("seed", "starts")),
        (commands.launch, fp.launch, ("seed", "starts")),
        (motions.replay, fp.closed_loop, ("seed", "budget")),
        (clips.clip_repair, repair_clip, ("choice", "degree", "stances")),
        (clips.bench, fp.bench, ("seed",)),
    ],
)
def test_defaults_are_those_of_the_function(command, function, names):
    own = inspect.signature(command).parameters
    of_function = inspect.signature(inspect.unwrap(function)).parameters
    for name in names:
        assert own[name].default == of_function[name].default


@pytest.mark.parametrize(
    ("command", "function", "names"),
    [
        ("bench", fp.bench, ("flights", "perturb", "friction")),
        ("replay", fp.closed_loop, ("flights", "perturb", "feedback")),
    ],
)
def test_help_names_the_function_s_defaults(command, function, names, floatplan):
    text = "".join(floatplan(command, "--help").stdout.split())
    for name in names:
        default = inspect.signature(inspect.unwrap(function)).parameters[name].default
        assert (default if isinstance(default, str) else f"{default:g}") in text
