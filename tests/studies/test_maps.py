"""Maps: cells, statuses that are told apart, and the page in a browser."""

import numpy as np
import pyarrow
import pytest
from matplotlib.colors import to_rgb
from places import ROOT

import floatplan as fp
from floatplan import InputError
from floatplan.studies.file import load_study_file
from floatplan.studies.maps import STATUS_LOOKS, heatmap, study_map
from floatplan.studies.rows import STATUSES

THREE = """
[vary]
"flight.angular_momentum" = [3.0, 4.0]
"flight.duration" = [1.0, 1.2]
"goal.positions.q1" = [-60, -50]
"""
POSTURE = """
    const posture = floatplan.stage.motion.posture(arguments[0]);
    return [posture.orientation, ...posture.positions, ...posture.com];
"""
MARK = """
    const found = ["#map .u-over", ".mark.selected"].map((one) => document.querySelector(one));
    const [over, mark] = found.map((one) => one.getBoundingClientRect());
    const middle = [mark.left + mark.width / 2 - over.left, over.bottom - mark.top - mark.height / 2];
    return [mark.width / over.width, mark.height / over.height, middle[0] / over.width, middle[1] / over.height];
"""
PRESS = """
    const event = new KeyboardEvent("keydown", { key: arguments[0], bubbles: true });
    document.getElementById("map").dispatchEvent(event);
    return floatplan.map.selected;
"""


def table(asked, statuses, torques):
    values = asked.samples.values(0, len(asked))
    return pyarrow.table({**values, "status": statuses, "torque_peak": torques})


def test_each_cell_shows_its_best_row(study_file):
    asked = load_study_file(study_file(THREE))
    statuses = ["optimal", "optimal", "not_found", "impossible", "impossible", "impossible", "error", "feasible"]
    torques = [5.0, 3.0, None, None, None, None, None, 7.0]
    shown = study_map(
        asked, table(asked, statuses, torques), "flight.angular_momentum", "flight.duration", "torque_peak"
    )
    names = np.array(STATUSES)[shown.status]
    assert names.tolist() == [["optimal", "impossible"], ["not_found", "feasible"]]
    np.testing.assert_array_equal(shown.colour, [[3.0, np.nan], [np.nan, 7.0]])
    assert shown.title == "best over goal.positions.q1"


def test_what_was_not_found_is_never_drawn_as_impossible(study_file):
    asked = load_study_file(study_file(THREE))
    statuses = ["not_found", "impossible", "impossible", "impossible", "error", "error", "optimal", "not_found"]
    shown = study_map(
        asked, table(asked, statuses, [1.0] * 8), "flight.angular_momentum", "flight.duration", "torque_peak"
    )
    assert len({colour for colour, _ in STATUS_LOOKS.values()}) == len(STATUSES)
    assert tuple(STATUS_LOOKS) == STATUSES
    figure = heatmap(shown)
    values = [study_axis.values for study_axis in asked.samples.axes if study_axis.path == "flight.duration"]
    written = [float(label.get_text()) for label in figure.axes[0].get_yticklabels()]
    np.testing.assert_allclose(written, np.unique(values), rtol=1e-3)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert [label.split(":")[0] for label in labels] == ["not found", "impossible", "error"]
    (image,) = figure.axes[0].images
    drawn = np.asarray(image.get_array())[..., :3] / 255
    for row, column in ((0, 1), (1, 0)):
        np.testing.assert_allclose(
            drawn[row, column], to_rgb(STATUS_LOOKS[STATUSES[shown.status[row, column]]][0]), atol=1 / 255
        )
    assert np.array(STATUSES)[shown.status].tolist() == [["not_found", "error"], ["impossible", "optimal"]]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (("flight.duration", "flight.duration", "torque_peak"), "the same key"),
        (("flight.gravity", "flight.duration", "torque_peak"), "'flight.gravity' does not vary"),
        (("flight.angular_momentum", "flight.duration", "explanation"), "is no column of numbers"),
    ],
)
def test_wrong_maps(study_file, keys, message):
    asked = load_study_file(study_file(THREE))
    with pytest.raises(InputError, match=message):
        study_map(asked, table(asked, ["optimal"] * 8, [1.0] * 8), *keys)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    path = folder / "asked.toml"
    path.write_text(
        f'problem = "{ROOT / "problems" / "somersault.toml"}"\n[vary]\n'
        '"flight.angular_momentum" = { from = 3, to = 4.4, count = 5 }\n'
        '"flight.duration" = { from = 1, to = 1.4, count = 4 }\n'
    )
    return fp.study(path, folder=folder / "out", jobs=1)


class TestPage:
    @pytest.mark.parametrize("size", [(1400, 900), (390, 844)])
    def test_asks_for_nothing_and_fits(self, browser, study, size):
        browser.driver.set_window_size(*size)
        browser.open(study.folder / "map.html")
        assert browser.requests() == [(study.folder / "map.html").resolve().as_uri()]
        assert browser.complaints() == []
        assert browser.run("return document.documentElement.scrollWidth <= innerWidth")

    def test_a_point_s_plan_is_flown_as_python_flies_it(self, browser, study):
        browser.open(study.folder / "map.html")
        row = study.table["status"].to_pylist().index("optimal")
        browser.run("floatplan.choose(arguments[0]); floatplan.player.pause()", row)
        plan = study.plan(row)
        for share in (0.0, 0.37, 1.0):
            time = share * plan.duration
            seen = browser.run(POSTURE, time)
            state = plan.at(time)
            wanted = [state.orientation, *state.positions, *state.com_position]
            np.testing.assert_allclose(seen, wanted, atol=2e-4)
        assert "optimal" in browser.run("return document.getElementById('verdict').textContent")

    def test_holds_the_table_s_numbers(self, browser, study):
        browser.open(study.folder / "map.html")
        shown = browser.run("return Object.keys(floatplan.data.columns)")
        assert {"objective", "torque_peak.q1", "milliseconds"} <= set(shown)
        assert "clearance" not in shown  # no row has one
        for name in shown:
            seen = browser.run("return Array.from(floatplan.rows.column(arguments[0]), String)", name)
            np.testing.assert_array_equal(
                np.array(seen, dtype=np.float64), study.table[name].to_numpy().astype(np.float32)
            )

    def test_keys_move_from_cell_to_cell(self, browser, study):
        browser.open(study.folder / "map.html")
        assert [browser.run(PRESS, key) for key in ("ArrowUp", "ArrowRight", "ArrowUp", "ArrowLeft")] == [0, 4, 5, 1]
        for change in ("", "floatplan.redraw()"):
            browser.run(change)
            wide, high, left, low = browser.run(MARK)
            assert (wide, high) == (pytest.approx(1 / 5, abs=0.02), pytest.approx(1 / 4, abs=0.02))
            assert (left, low) == (pytest.approx(0.5 / 5, abs=0.02), pytest.approx(1.5 / 4, abs=0.02))
