"""Clearances in space: what is clear is proved, what is not is refuted, and bounds are below the distances."""

from dataclasses import replace

import numpy as np
import pytest
from proof_records import assert_no_false_proof, finding
from space_distances import Distances, between
from space_mutations import LEFT, _dense, _Key, _least, certificate_of, judge, mutate, shape_plans

import floatplan as fp
from floatplan.certificate.certificate import capsules_of, prove, solids_of
from floatplan.certificate.enclosure import Balls, Taylor
from floatplan.certificate.spatial.clearance import FaceDistances, Heights, SegmentPairs, Segments, Solid
from floatplan.certificate.spatial.models import Matrices
from floatplan.errors import InputError
from floatplan.plans.reading import checked, recorded_robot
from floatplan.plans.verdicts import Certificate
from floatplan.robot.urdf.tree import urdf_path

MUTATIONS = 5  # scripts/mutations.py makes more
SHARP = 3e-6  # [m] to which least distances are enclosed, and found by the judge
SHORT = {"pairs": 2e-3, "heights": 2e-3, "faces": 2e-2}  # [m] to which bounds over a 32nd of a cell are sharp
LITTLE = 1e-6  # [m] that a violation is refuted by


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    return shape_plans(str(tmp_path_factory.mktemp("robots")))


def with_obstacles(record, *obstacles, least=None):
    """The record with other obstacles, and the least distance to them as its claim."""
    asked = replace(record, problem={**record.problem, "obstacles": list(obstacles)})
    distances = Distances(record, _dense(_Key(record)))
    if least is None:
        least = min(_least(distances, obstacle) for obstacle in obstacles)
    return replace(asked, clearance_min=None if np.isinf(least) else least)


class TestWhatIsClear:
    """Plans that keep clear by 5 nm more than asked."""

    def test_is_proved(self, plans):
        for record in plans:
            certificate = certificate_of(record)
            assert certificate.proved, certificate.unproved
            assert certificate.clearance_min == pytest.approx(record.clearance_min, abs=SHARP)
            for index, obstacle in enumerate(record.problem["obstacles"]):
                found = finding(certificate, f"obstacles[{index}] {obstacle['kind']}")
                assert obstacle["margin"] - 1e-8 <= found.bound <= obstacle["margin"] + 2 * LEFT
            again = Certificate.from_dict(certificate.to_dict())
            assert again.to_dict() == certificate.to_dict()
            if record.problem.get("ground"):
                assert finding(certificate, "ground").bound == pytest.approx(0, abs=1e-8)

    def test_is_refuted_where_it_is_not(self, plans):
        """All of a plan's obstacles and pairs of links at once, and nothing else of it."""
        for record in plans:
            obstacles = record.problem["obstacles"]
            pairs = record.problem["self_clearance"]
            nearer = {
                name: [{**each, "margin": each["margin"] + LITTLE} for each in record.problem[name]]
                for name in ("obstacles", "self_clearance")
            }
            certificate = certificate_of(replace(record, problem=record.problem | nearer))
            of_obstacles = [each for each in certificate.unproved if each.kind == "obstacle"]
            assert sorted(each.subject[0] for each in of_obstacles) == list(range(len(obstacles)))
            others = [each for each in certificate.unproved if each.kind != "obstacle"]
            labels = ["self_clearance {} {}".format(*pair["links"]) for pair in pairs]
            assert sorted(each.label for each in others) == sorted(labels)
            assert {each.verdict for each in certificate.unproved} == {"refuted"}
            distances = Distances(record, _dense(_Key(record)))
            for found in of_obstacles:
                seen = distances.to_obstacle(obstacles[found.subject[0]], np.array([found.instant])).min()
                assert seen == pytest.approx(found.bound, abs=1e-8)

    def test_below_the_ground_is_refuted(self, plans):
        go2 = plans[1]
        lying = {**go2.com, "velocity0": [0.3, -0.2, -0.1]}
        found = finding(certificate_of(replace(go2, com=lying)), "ground")
        assert found.verdict == "refuted"
        assert found.bound < -0.1


class TestWindows:
    """An obstacle in the way counts while it is there."""

    def test_one_that_is_gone_is_passed_through(self, plans):
        diver = plans[0]
        there = diver.com["position0"]
        ball = {"kind": "sphere", "center": there, "radius": 0.1, "margin": 0.0}
        for window, verdict in (([0.0, 0.1], "refuted"), ([0.9, 1.1], "proved"), ([5.0, 6.0], "proved")):
            certificate = certificate_of(with_obstacles(diver, ball | {"window": window}))
            assert finding(certificate, "obstacles[0] sphere").verdict == verdict

    def test_it_ends_within_a_cell(self, plans):
        """A ceiling that the diver comes to at some instant: proved until just before, refuted just after."""
        diver = plans[0]
        distances = Distances(diver, _dense(_Key(diver)))
        ceiling = {"kind": "half-space", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, -1.0], "margin": 0.0}
        times = np.linspace(0.0, diver.duration, 4001)
        top = -distances.to_obstacle(ceiling, times).min(axis=1)
        ceiling["point"] = [0.0, 0.0, float(top[0] + top.max()) / 2]
        first = times[(top > ceiling["point"][2]).argmax()]
        assert 0.01 < first < 1.1
        for end, verdict in ((first - 1e-3, "proved"), (first + 1e-3, "refuted")):
            certificate = certificate_of(with_obstacles(diver, ceiling | {"window": [0.0, float(end)]}))
            assert finding(certificate, "obstacles[0] half-space").verdict == verdict

    @pytest.mark.parametrize("instant", [0.0, 0.371, 1.2])
    def test_of_an_instant(self, plans, instant):
        """Only the distance at that instant counts, whichever pair is nearest at others."""
        diver = plans[0]
        distances = Distances(diver, _dense(_Key(diver)))
        ball = {"kind": "sphere", "center": [0.3, -1.3, 2.0], "radius": 0.2, "margin": 0.0}
        least = float(distances.to_obstacle(ball, np.array([instant])).min())
        window = [instant, instant] if instant else [-1.0, 0.0]
        for off, verdict in ((-LEFT, "proved"), (LITTLE, "refuted")):
            asked = ball | {"window": window, "margin": least + off}
            found = finding(certificate_of(with_obstacles(diver, asked, least=least)), "obstacles[0] sphere")
            assert found.verdict == verdict
            assert found.bound == pytest.approx(least, abs=1e-8)


class TestBounds:
    """Least distances over pieces of drawn motions: bounds are below them, and sharp where pieces are short."""

    @pytest.mark.parametrize("seed", range(6))
    @pytest.mark.parametrize("kind", ["pairs", "heights", "faces"])
    def test_are_below_what_is_seen_and_near_it(self, kind, seed):
        rng = np.random.default_rng(seed)
        distances, seen = drawn_distances(rng, kind, degenerate=seed % 3 == 0)
        cells = np.arange(2)
        members = np.arange(distances.count)
        items = distances.forms(np.repeat(cells, len(members)), np.tile(members, len(cells)))
        for halvings in (0, 1, 1, 1, 1, 1):
            items = items.split(np.arange(len(items.cell)), halvings)
            bound = distances.below(items.forms, items.member)
            u = items.start[:, None] + items.width * np.linspace(0, 1, 41)
            values = np.empty(u.shape)
            for cell, member in np.ndindex(len(cells), len(members)):
                own = (items.cell == cell) & (items.member == member)
                values[own] = seen(cell, member, u[own].ravel()).reshape(-1, u.shape[1])
            assert (bound <= values.min(axis=1) + 1e-12).all()
            above = distances.at_point(items.ends, items.member)
            assert above == pytest.approx(values[:, [0, -1]].T, abs=1e-9)
            assert (above >= values[:, [0, -1]].T - 1e-12).all()
        assert (values.min(axis=1) - bound).max() < SHORT[kind]

    def test_radii_of_models_are_taken_off(self):
        rng = np.random.default_rng(7)
        sharp, _ = drawn_distances(rng, "pairs")
        wide = SegmentPairs(*(each.widened(np.full(each.e.shape, 1e-3)) for each in vectors_of(sharp)), sharp.radius)
        items, wider = (each.forms(np.zeros(3, int), np.arange(3)) for each in (sharp, wide))
        bounds, lower = sharp.below(items.forms, items.member), wide.below(wider.forms, wider.member)
        clear = bounds > -sharp.radius.mid + 0.02
        assert clear.any()
        assert (lower[clear] < bounds[clear] - 2.9e-3).all()
        assert (wide.at_point(wider.ends, wider.member) > sharp.at_point(items.ends, items.member) + 2.9e-3).all()
        uncertain = replace(sharp, radius=Balls(sharp.radius.mid, np.full_like(sharp.radius.mid, 1e-3)))
        assert (uncertain.below(items.forms, items.member) < bounds - 0.9e-3).all()
        above = uncertain.at_point(items.ends, items.member)
        assert (above > sharp.at_point(items.ends, items.member) + 0.9e-3).all()


def vectors_of(pairs):
    return pairs.between, pairs.first, pairs.second


def drawn_distances(rng, kind, degenerate=False):
    """Distances of three members on two cells, and the function that says them at u, of a cell and a member."""

    def vectors(middle, size):
        c = rng.normal(size=(2, 3, 16, 3, 1)) * size * 0.4 ** np.arange(16)[:, None, None]
        c[:, :, 0] += np.array(middle)[:, None]
        return Matrices.exact(c)

    def at(vector, cell, member, u):
        return u[:, None] ** np.arange(16) @ vector.c[cell, member, :, :, 0]

    if kind == "heights":
        normal = vectors([0.0, 0.0, 1.0], 0.3)
        offset = Taylor(rng.normal(size=(16, 2, 3)) * 0.4 ** np.arange(16)[:, None, None], np.zeros((2, 3)))
        axes = 0.0 if degenerate else 0.1
        solids = [
            Solid("link", 1, Balls.exact(rng.normal(size=(5, 3))), Balls.exact(axes * rng.normal(size=(3, 3))))
            for _ in range(3)
        ]

        def height(cell, member, u):
            solid, up = solids[member], at(normal, cell, member, u)
            lowest = (up @ solid.points.mid.T).min(axis=1) - np.linalg.norm(up @ solid.axes.mid, axis=1)
            return u[:, None] ** np.arange(16) @ offset.c[:, cell, member] + lowest

        return Heights(solids, normal, offset), height
    start, along = vectors([1.0, 0.5, 0.0], 0.5), vectors([0.3, 0.1, 0.2], 0.2)
    radius = np.array([0.0, 0.1, 0.2])
    if kind == "faces":
        half = np.array([0.3, 0.2, 0.1])

        def over_faces(cell, member, u):
            one = at(start, cell, member, u)
            other = one + at(along, cell, member, u)
            above = np.maximum(np.minimum(one, other), -np.maximum(one, other)) - half
            return above.max(axis=1) - radius[member]

        return FaceDistances(Segments(start, along, radius), half), over_faces
    second = along if degenerate else vectors([0.0, 0.2, 0.0], 0.3)  # parallel all along

    def apart(cell, member, u):
        w, one, other = (at(each, cell, member, u) for each in (start, along, second))
        return between(w, w + one, 0 * w, other) - radius[member]

    return SegmentPairs(start, along, second, Balls.exact(radius)), apart


class TestWhatIsNotKnown:
    """Nothing is proved of distances where the attitude or the shapes are not known."""

    def test_an_attitude_without_a_bound(self, plans):
        wild = np.array(plans[0].coefficients)
        wild[:, 1] += 60.0
        problem = {**plans[0].problem, "obstacles": plans[0].problem["obstacles"][:1], "self_clearance": []}
        record = replace(plans[0], coefficients=wild, problem=problem)
        robot = recorded_robot(record.robot)
        path = urdf_path(record.robot.file)
        shapes = (capsules_of(robot), solids_of(robot))
        certificate = prove(checked(record), path, shapes, (), 26)
        assert certificate.attitude_bound == np.inf
        verdicts = [each.verdict for each in certificate.findings if each.kind == "obstacle"]
        assert verdicts == ["undecided"]
        assert certificate.clearance_min < -0.5  # links are no farther in than their radius, wherever they are

    def test_meshes_whose_hash_is_not_recorded(self, plans):
        record = plans[0]
        robot = recorded_robot(record.robot)
        shapes = (capsules_of(robot), solids_of(robot))
        certificate = prove(checked(record), urdf_path(record.robot.file), shapes, ("arm.stl",), 4096)
        assert certificate.verdict == "undecided"
        kinds = {each.kind for each in certificate.unproved}
        assert kinds == {"mesh", "obstacle", "self_clearance", "recorded"}
        assert certificate.clearance_min is None

    def test_shapes_that_are_not_passed_on(self, plans):
        with pytest.raises(InputError, match="has a <collision> element, so its shape has to be given"):
            prove(checked(plans[0]), urdf_path(plans[0].robot.file), (None, None), (), 4096)


def test_no_false_proof_and_hardly_a_false_alarm(plans, tmp_path):
    rng = np.random.default_rng(20261129)
    drawn = (mutate(rng, plans[number % len(plans)], tmp_path) for number in range(MUTATIONS))
    assert_no_false_proof(drawn, lambda case: judge(case.record), certificate_of)


def test_clearances_are_in_the_answer_of_certify(tmp_path, planned):
    plan = planned("space/diver_past_a_bar")
    assert plan.certificate.proved
    assert plan.certificate.to_dict()["clearance_min"] == pytest.approx(plan.record.clearance_min, abs=SHARP)
    again = fp.certify(plan.save(tmp_path / "plan.json"))
    assert again.proved
    assert again.clearance_min == plan.certificate.clearance_min


STANDING = """<mujoco><worldbody><body name="trunk"><freejoint/><geom type="box" size="0.1 0.1 0.3" mass="10"/>
<body name="left" pos="0 0.15 0.25"><joint name="left" axis="1 0 0" range="-120 120"/>
<geom type="capsule" fromto="0 0 0 0 0.4 0" size="0.05" mass="2"/></body>
<body name="right" pos="0 -0.15 0.25"><joint name="right" axis="1 0 0" range="-120 120"/>
<geom type="capsule" fromto="0 0 0 0 -0.4 0" size="0.05" mass="2"/></body>
<body name="leg" pos="0 0 -0.35"><joint name="leg" axis="0 1 0" range="-120 120"/>
<geom type="cylinder" pos="0 0 -0.2" size="0.05 0.2" mass="2"/></body></body></worldbody></mujoco>"""


def test_a_robot_of_an_mjcf_that_stands_on_a_disc(tmp_path):
    """Its leg tilts, and leaves the ground with the rim."""
    path = tmp_path / "standing.xml"
    path.write_text(STANDING)
    robot = fp.Robot.from_mjcf(path, base="free-flyer")
    start = fp.Posture(fp.Attitude(angles=(0, 0, 0), axes="yxz"), (0.1, 0.2, 0.0))
    goal = fp.Posture(fp.Attitude(angles=(0.5, 0, 0), axes="yxz"), (0.3, -0.2, 0.3))
    problem = fp.Problem(
        robot,
        start,
        goal,
        fp.Flight(0.6, "free", takeoff=fp.Takeoff("leg")),
        fp.Motion(degree="auto"),
        ground=True,
        obstacles=(fp.Sphere(center=(0.9, 0, 1.5), radius=0.1), fp.HalfSpace(point=(0, 0, 1.8), normal=(0, 0, -1))),
        self_clearances=(fp.SelfClearance(("left", "right"), 0.01),),
    )
    certificate = fp.certify(fp.plan(problem))
    assert certificate.proved, certificate.unproved
    assert finding(certificate, "ground").bound == pytest.approx(0, abs=1e-8)
    assert finding(certificate, "self_clearance left right").bound == pytest.approx(0.2, abs=0.01)
