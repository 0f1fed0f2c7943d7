"""The report as a file: one page, whole, with nothing outside it, and safe whatever its names are."""

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
from PIL import Image

import floatplan as fp
from floatplan.errors import InputError
from floatplan.plans.verdicts import Finding
from floatplan.view.figures.animation import FILM, animate
from floatplan.view.report.report import report, report_data, write_report
from floatplan.view.scene.scene import scene

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


def test_it_says_what_was_asked_found_and_proved(planned: Callable[[str], fp.Plan]) -> None:
    plan = fp.plan(planned("new_configuration").problem)
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


def test_no_plan_has_a_report_too(handstand: fp.Plan) -> None:
    assert report_data(replace(handstand, ok=False, status="infeasible"))["verdict"]["tone"] == "bad"


def test_the_same_plan_gives_the_same_page(handstand: fp.Plan, page: str, tmp_path: Path) -> None:
    assert write_report(handstand, tmp_path / "a.html").read_text() != ""
    assert report(handstand) == page


def test_a_scene_without_viser_says_what_to_install(
    floatplan: Callable[..., Any], handstand: fp.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(InputError, match=re.escape("[view]'")):
        scene(handstand)
    run = floatplan("show", handstand.save(tmp_path / "plan.json"), "--scene")
    assert run.code == 2
    assert "[view]'" in run.stderr


def test_a_film_has_the_flight_s_length(handstand: fp.Plan, tmp_path: Path) -> None:
    path = handstand.animate(tmp_path / "flight.gif", speed=2.0)
    with Image.open(path) as film:
        assert film.n_frames == round(handstand.duration / 2.0 * FILM.rate) + 1
        first = np.asarray(film.convert("RGB"))
        assert (first[0] == 255).all()  # on white paper
        film.seek(film.n_frames - 1)
        assert (first != np.asarray(film.convert("RGB"))).any()
    assert 0 < FILM.speed <= 1


def test_a_film_without_ffmpeg_says_so(handstand: fp.Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="ffmpeg is not installed"):
        animate(handstand, tmp_path / "flight.mp4")
