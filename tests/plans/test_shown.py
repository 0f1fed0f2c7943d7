"""How problems, plans, replays and certificates show themselves at a prompt and in notebooks."""

from dataclasses import replace
from html.parser import HTMLParser

import pytest

import floatplan as fp


class Cells(HTMLParser):
    """The texts of a table's cells, and the tags."""

    def __init__(self, text):
        super().__init__()
        self.tags = set()
        self.texts = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)

    def handle_data(self, data):
        self.texts.append(data)


def test_notebooks_show_tables(planned):
    plan = planned("obstacle")
    certificate = fp.certify(plan)
    for shown, expected in (
        (
            plan.problem,
            [plan.problem.name, "1.4 s", "foot at (0, 0) m", "start", "circle at (1.485, 3.342) m, radius 0.2 m"],
        ),
        (fp.replay(plan), ["orientation", "off by"]),
        (certificate, ["constraint", *(finding.label for finding in certificate.findings)]),
    ):
        cells = Cells(shown._repr_html_())
        assert {"table", "td"} <= cells.tags
        for text in expected:
            assert any(text in cell for cell in cells.texts), (text, cells.texts)


@pytest.mark.parametrize("name", ["handstand", "space/cat"])
def test_notebooks_draw_robots(root, name):
    """A polygon for each solid, and a table; short enough to be kept in the notebook."""
    robot = fp.load_problem(root / "problems" / f"{name}.toml").robot
    text = robot._repr_html_()
    cells = Cells(text)
    assert {"table", "svg", "polygon"} <= cells.tags
    assert robot.name in cells.texts
    assert ", ".join(robot.joints) in cells.texts
    assert 2 <= text.count("<polygon") <= len(robot.solids)
    assert "nan" not in text
    assert len(text) < 10_000


def test_notebooks_show_the_first_of_many_plans(planned):
    problem = planned("handstand").problem
    impossible = replace(problem, limits=fp.Limits(position="full", velocity=1e-3))
    cells = Cells(fp.plan_many([problem, impossible])._repr_html_())
    assert "2 plans: 1 impossible, 1 optimal" in cells.texts
    assert cells.texts[cells.texts.index("0") :][:2] == ["0", "optimal"]
    assert "1" in cells.texts
    many = fp.plan_many([problem] * 30)
    cells = Cells(many._repr_html_())
    assert "10 more" in cells.texts


def test_what_is_not_proved_comes_first(planned):
    record = planned("handstand").record
    certificate = fp.certify(replace(record, angular_momentum=record.angular_momentum + 1e-3))
    assert certificate.unproved[0].label in repr(certificate).splitlines()[1]
    texts = [text for text in Cells(certificate._repr_html_()).texts if text.strip()]
    assert texts[texts.index("at, s") + 2] == "refuted"
