"""The report as a file: one page, whole, with nothing outside it, and safe whatever its names are."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

import floatplan as fp
from floatplan.errors import InputError
from floatplan.plans.verdicts import Finding
from floatplan.tables import JOINT_LIMITS, LimitRow
from floatplan.view.figures.animation import FILM, animate
from floatplan.view.figures.figures import figures
from floatplan.view.report.data import FEWEST_SAMPLES, MOST_SAMPLES, rounded, sample_grid
from floatplan.view.report.report import escaped_json, filled, report, report_data, write_report
from floatplan.view.scene.scene import obstacle_slab, prism, quaternions, scene

LARGEST = 5_000_000  # bytes of the gymnast's page


@pytest.fixture(scope="module")
def page(handstand: fp.Plan) -> str:
    return report(handstand)


class Outside(HTMLParser):
    """Collects what a page refers to, and its scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.scripts = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += tag == "script"
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "data", "action")]


def data_of(page: str) -> Any:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1])


def test_it_is_one_small_page_that_names_no_address(page: str) -> None:
    assert len(page.encode()) < LARGEST
    outside = Outside()
    outside.feed(page)
    assert {address.partition(",")[0] for address in outside.addresses} == {"data:", "data:application/toml"}
    assert "default-src 'none'" in page
    assert "{{" not in page.split("<script>")[0]


def test_names_cannot_leave_their_element(handstand: fp.Plan, page: str) -> None:
    name = "</script><script>alert(1)</script><!-- {{data}} & \"'"
    hostile = report(replace(handstand, problem=replace(handstand.problem, name=name)))
    assert name not in hostile
    assert data_of(hostile)["name"] == name
    counts = []
    for text in (page, hostile):
        reader = Outside()
        reader.feed(text)
        counts.append(reader.scripts)
    assert counts[0] == counts[1]


def test_json_in_a_page_reads_back() -> None:
    content = {"<&>\u2028\u2029": ["</script>", "<!--", 1.5, None]}
    assert json.loads(escaped_json(content)) == content
    assert not set("<>&\u2028\u2029") & set(escaped_json(content))


def test_what_is_put_in_is_not_looked_at_again() -> None:
    assert filled("{{a}} {{b}}", {"a": "{{b}}", "b": "x"}) == "{{b}} x"


def test_samples_hold_the_middle_of_the_flight(handstand: fp.Plan) -> None:
    for duration in (1e-3, 0.65, 1.4, 3.0, 100.0):
        grid = sample_grid(duration)
        assert FEWEST_SAMPLES <= len(grid) <= MOST_SAMPLES
        assert grid[len(grid) // 2] == pytest.approx(duration / 2, rel=1e-15)
    motion = report_data(handstand)["motion"]
    state = handstand.at(handstand.duration / 2)
    middle = len(motion["columns"]["orientation"]) // 2
    assert motion["columns"]["orientation"][middle] == pytest.approx(state.orientation, rel=1e-10)


def test_numbers_are_rounded_and_gaps_are_null() -> None:
    assert rounded([1 / 3, np.nan, np.inf]) == [0.33333333333, None, None]
    assert rounded([[1.0], [2.0]]) == [[1.0], [2.0]]


def test_it_says_what_was_asked_found_and_proved(planned: Callable[[str], fp.Plan]) -> None:
    plan = planned("new_configuration")
    data = report_data(plan)
    assert [section["title"] for section in data["sections"]] == [
        *("Problem", "Result", "Proved", "Use of limits", "Warnings")
    ]
    assert data["verdict"] == {"word": "planned, not proved yet", "tone": "open"}
    assert 'urdf = "' in data["problem"]
    findings = (Finding("torque", ("q1",), "proved", 1.0), Finding("ground", (), "undecided", None))
    certificate = replace(fp.certify(plan), verdict="undecided", findings=findings)
    data = report_data(plan.with_record(plan.record.with_checks(certificate=certificate.to_dict())))
    assert data["verdict"] == {"word": "planned, proof undecided", "tone": "open"}
    assert data["sections"][2]["findings"][1] == [
        ["ground", "undecided", "-", "-", "-"],
        ["torque q1", "proved", "1", "-", "-"],
    ]
    certificate = replace(certificate, verdict="proved", findings=findings[:1])
    data = report_data(plan.with_record(plan.record.with_checks(certificate=certificate.to_dict())))
    assert data["verdict"] == {"word": "flight proved, with warnings", "tone": "open"}
    assert data["sections"][2]["rows"][0][1].startswith("proved: 1 of 1 constraints hold at every instant (")


def test_it_tells_how_frames_leave_and_meet_the_ground(handstand: fp.Plan) -> None:
    sections = {section["title"]: dict(section["rows"]) for section in report_data(handstand)["sections"]}
    assert sections["Result"]["takeoff"] == "foot leaves the ground at rest with 354 rad/s at -1.1778 kg m²/s"
    assert sections["Result"]["landing"] == "hand cannot meet the ground at rest: no joint rates stop it"
    assert "stretched out" in sections["Warnings"]["landing hand"]


def test_no_plan_has_a_report_too(handstand: fp.Plan) -> None:
    assert report_data(replace(handstand, ok=False, status="infeasible"))["verdict"]["tone"] == "bad"


def test_limits_that_joints_share_are_one_line_and_far_ones_none(handstand: fp.Plan) -> None:
    def lines(**limits: Any) -> list[Any]:
        problem = replace(handstand.problem, limits=fp.Limits(position="full", **limits))
        return [chart["lines"] for chart in report_data(replace(handstand, problem=problem))["charts"]]

    assert [len(each) for each in lines(torque=4.0, velocity=9.0)] == [0, 2, 2, 2, 0]  # two for the interval of h
    assert [len(each) for each in lines(torque={"q1": 4.0, "q2": 3.0}, orientation_rate=6.0)] == [0, 2, 4, 2, 0]
    assert [len(each) for each in lines(torque=1000.0)] == [0, 0, 0, 2, 0]
    far = replace(handstand.problem, limits=fp.Limits(position="full", torque={"q1": 1000.0, "q2": 3.0}))
    torques = report_data(replace(handstand, problem=far))["charts"][2]
    assert torques["beyond"] == "limits from 1000, not drawn"
    assert [line["name"] for line in torques["lines"]] == ["limit"] * 2
    motor = lines(motor={"q1": fp.Motor(5.0, 0.2)})[2]
    assert len(motor[0]["value"]) == len(sample_grid(handstand.duration))


def test_it_draws_the_curves_of_the_figures(handstand: fp.Plan) -> None:
    """The same names in the same colours, chart by chart."""
    drawn = [figure for name, figure in figures(handstand).items() if name not in ("snapshots", "kinogram")]
    for chart, figure in zip(report_data(handstand)["charts"], drawn, strict=True):
        texts = [text.get_text() for text in figure.legends[0].get_texts()]
        handles = [line.get_color() for line in figure.legends[0].get_lines()]
        shown = [(name, to_hex(colour)) for name, colour in zip(texts, handles, strict=True)]
        series = [(each["name"], each["colour"].lower()) for each in chart["series"]]
        assert shown[: len(series)] == series


def test_a_limit_of_another_quantity_is_drawn(handstand: fp.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    row = LimitRow("velocity", "torques", "N m", "Generalised", "joints", always=True)
    monkeypatch.setattr("floatplan.view.charts.JOINT_LIMITS", (*JOINT_LIMITS, row))
    monkeypatch.setattr("floatplan.view.sampled.JOINT_LIMITS", (*JOINT_LIMITS, row))
    data = report_data(handstand)
    chart = next(each for each in data["charts"] if each["title"] == "Generalised")
    columns = [data["motion"]["columns"][series["key"]] for series in chart["series"]]
    np.testing.assert_allclose(columns, handstand.at(sample_grid(handstand.duration)).torques.T, rtol=1e-9, atol=1e-9)
    assert "generalised" in figures(handstand)


def test_the_same_plan_gives_the_same_page(handstand: fp.Plan, page: str, tmp_path: Path) -> None:
    assert write_report(handstand, tmp_path / "a.html").read_text() != ""
    assert report(handstand) == page


def test_show_writes_the_report_beside_the_plan(
    floatplan: Callable[..., Any], handstand: fp.Plan, tmp_path: Path
) -> None:
    plan_file = handstand.save(tmp_path / "run" / "plan.json")
    run = floatplan("show", plan_file)
    assert (run.code, run.stdout.strip()) == (0, str(plan_file.parent / "report.html"))
    assert floatplan("show", plan_file, "--svg", "--compare", plan_file, "-o", "there", "--quiet").stdout == ""
    assert {path.name for path in Path("there").iterdir()} == {"figures"}
    assert (Path("there") / "figures" / "comparison.svg").is_file()


def test_plan_writes_a_report_where_asked(floatplan: Callable[..., Any], root: Path) -> None:
    run = floatplan("plan", root / "problems" / "handstand.toml", "-o", "out", "--report", "--no-figures")
    assert run.code == 0, run
    assert data_of(Path("out/report.html").read_text())["name"] == "handstand"
    assert "report" in run.stdout
    assert len(run.stderr.splitlines()) <= 25


def test_show_refuses_what_it_cannot_do(floatplan: Callable[..., Any], handstand: fp.Plan, tmp_path: Path) -> None:
    plan_file = handstand.save(tmp_path / "run" / "plan.json")
    (tmp_path / "run" / "report.html").mkdir()
    assert floatplan("show", plan_file).code == 2
    assert floatplan("show", tmp_path).code == 2
    assert floatplan("show", plan_file, "--gif", "--speed", "0", "-o", "there").code == 2
    plan_file.write_text(plan_file.read_text()[:-100])
    assert floatplan("show", plan_file, "-o", "there").code == 2


def test_a_scene_without_viser_says_what_to_install(
    floatplan: Callable[..., Any], handstand: fp.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=re.escape("[view]'")):
        scene(handstand)
    run = floatplan("show", handstand.save(tmp_path / "plan.json"), "--scene")
    assert run.code == 2
    assert "[view]'" in run.stderr


def test_slabs_are_closed_and_turns_are_turns(handstand: fp.Plan) -> None:
    corners = np.exp(1j * np.linspace(0, 2 * np.pi, 12, endpoint=False))
    vertices, faces = prism(handstand.robot.plane, corners, 0.5)
    edges = np.sort(np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2])), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert set(counts) == {4}  # each edge has two faces, each face two sides
    assert np.ptp(vertices @ handstand.robot.plane.normal) == pytest.approx(0.5)
    half = quaternions(handstand.robot.plane, np.array([np.pi]))
    np.testing.assert_allclose(half, [[0, *handstand.robot.plane.normal]], atol=1e-15)


def test_ground_and_walls_reach_beside_the_whole_flight(handstand: fp.Plan) -> None:
    low, high = -0.5 - 1.0j, 3.0 + 3.5j
    for normal, along in (((0.0, 2.0), 0), ((-1.0, 0.0), 1)):
        plane = handstand.robot.plane
        vertices, _ = obstacle_slab(handstand, fp.HalfPlane(point=(7.0, -0.2), normal=normal), low, high)
        flat = vertices @ np.stack((plane.horizontal, plane.vertical), axis=1)
        assert (flat @ normal).max() == pytest.approx(np.dot((7.0, -0.2), normal))
        assert flat[:, along].min() <= (low.real, low.imag)[along]
        assert flat[:, along].max() >= (high.real, high.imag)[along]


def test_a_film_has_the_flight_s_length(handstand: fp.Plan, tmp_path: Path) -> None:
    path = handstand.animate(tmp_path / "flight.gif", speed=2.0)
    with Image.open(path) as film:
        assert film.n_frames == round(handstand.duration / 2.0 * FILM.rate) + 1
        first = np.asarray(film.convert("RGB"))
        assert (first[0] == 255).all()  # on white paper
        film.seek(film.n_frames - 1)
        assert (first != np.asarray(film.convert("RGB"))).any()
    assert 0 < FILM.speed <= 1


@pytest.mark.parametrize(
    ("name", "speed"), [("flight.avi", 1.0), ("flight.gif", 0.0), ("flight.gif", float("nan")), ("flight.gif", 1e-9)]
)
def test_films_that_cannot_be(handstand: fp.Plan, tmp_path: Path, name: str, speed: float) -> None:
    with pytest.raises(InputError):
        handstand.animate(tmp_path / name, speed=speed)
    assert list(tmp_path.iterdir()) == []


def test_a_film_without_ffmpeg_says_so(handstand: fp.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="ffmpeg is not installed"):
        animate(handstand, tmp_path / "flight.mp4")


def test_a_notebook_gets_a_frame_of_its_own(handstand: fp.Plan, page: str) -> None:
    cell = handstand._repr_html_()
    assert cell.startswith('<iframe srcdoc="&lt;!DOCTYPE html&gt;')
    assert cell.count("<") == 2


def test_the_scene_s_clock_is_the_flight_s(handstand: fp.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """It begins at takeoff and ends at landing."""
    infra = pytest.importorskip("viser.infra")
    waited: list[float] = []
    at_once = infra.StateSerializer.insert_sleep

    def insert_sleep(serializer: Any, seconds: float) -> None:
        waited.append(seconds)
        at_once(serializer, seconds)

    monkeypatch.setattr(infra.StateSerializer, "insert_sleep", insert_sleep)
    scene(handstand)
    assert sum(waited) == pytest.approx(handstand.duration, rel=1e-12)
