"""Files of jumps of which any value may be anything: what is wrong is said with its place, in words of the file."""

import copy
import json
import random

import pytest
from fuzz_mutations import NUMBERS, TEXTS
from jumps import backflip, planned_jump

import floatplan as fp
from floatplan.errors import InputError

HOSTILE = (*NUMBERS, *TEXTS, None, True, [], {}, [[]], [None], {"": 0}, [1, "x"], "1.0")
PYTHON_WORDS = ("could not convert", "iterable", "subscriptable", "' object", "attribute", "unhashable", "NoneType")
LONG_LISTS = 1  # entries of a list of numbers that are spoiled, of all that are there


def places(value, path=()):
    """Paths of everything in a file, of long lists only some of the entries."""
    if path:
        yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from places(item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value[:LONG_LISTS]):
            yield from places(item, (*path, index))


def spoiled(content, path, value):
    other = copy.deepcopy(content)
    inside = other
    for step in path[:-1]:
        inside = inside[step]
    inside[path[-1]] = value
    return other


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_any_value_of_a_jumps_file_may_be_anything(tmp_path):
    """Each place with some hostile value: refused with file and place, or a jump whose check says what is broken."""
    content = json.loads(planned_jump("high_jumper").to_json())
    rng, path, refused = random.Random(0), tmp_path / "jump.json", 0
    chosen = [each for each in places(content) if each[0] != "flight" or len(each) < 3]
    for place in chosen:
        value = rng.choice(HOSTILE)
        path.write_text(json.dumps(spoiled(content, place, value)))
        try:
            found = fp.load_jump(path)
        except InputError as error:
            refused += 1
            message = str(error)
            assert str(path) in message
            assert not [word for word in PYTHON_WORDS if word in message], message
            continue
        assert found.check.ok in (True, False)
        assert not [name for name, figure in found.check.figures.items() if figure != figure]
    assert refused > len(chosen) / 2


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (("stances", 1, "v"), [["0.5"]], r"stances\[1\]\.v"),
        (("stances", 0, "contacts", 0, "frames"), ["no_such_frame"] * 2, r"stances\[0\]\.contacts\[0\]\.frames"),
        (("stances", 0, "contacts"), 3.5, r"stances\[0\]\.contacts: 3\.5"),
        (("stances", 1, "side"), "below", r"stances\[1\]\.side"),
        (("problem", "jump", "friction"), "much", r"problem\.jump\.friction"),
        (("flight", "angular_momentum"), "much", r"flight\.angular_momentum"),
    ],
)
def test_what_is_wrong_has_a_place_and_advice(place, value, said, tmp_path):
    path = tmp_path / "some.json"
    path.write_text(json.dumps(spoiled(json.loads(backflip().to_json()), place, value)))
    with pytest.raises(InputError, match=said) as caught:
        fp.load_jump(path)
    assert str(path) in str(caught.value)
    assert caught.value.advice
