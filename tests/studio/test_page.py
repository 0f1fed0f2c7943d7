"""The page without a browser: served to this machine alone, dragged, and drawn."""

from __future__ import annotations

import math
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from needed import skip_or_fail
from studio_insides import logged_errors
from studio_page import grip_places

import floatplan as fp
from floatplan.problem.parts import OBSTACLE_KINDS
from floatplan.robot.urdf.tree import robots_folder
from floatplan.studio import edits
from floatplan.studio.page import Studio, is_own_page, titled, unshared
from floatplan.view.scene.scene import RobotNodes, plane_position, world_points

ROOT = Path(__file__).parents[2]
PATIENCE = 600.0  # s for what takes a fraction of one, and lets others go first


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studio]:
    pytest.importorskip("viser")
    problem = fp.load_problem(ROOT / "problems" / "obstacle.toml")
    folder = str(tmp_path_factory.mktemp("saved"))
    with logged_errors() as errors, closing(Studio(problem, folder=folder, port=0, with_map=False)) as made:
        yield made
    assert errors == []


@pytest.fixture
def fresh(studio: Studio) -> Studio:
    """The studio with its first problem."""
    while studio.session.undo():
        pass
    return studio


CAMERA: dict[str, Any] = {
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 100,
    "image_width": 100,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


def answered(studio: Studio) -> fp.Plan:
    assert studio.session.wait(lambda view: view.is_current, PATIENCE)
    assert studio.painter.wait(PATIENCE)
    assert studio.session.view.result is not None
    return studio.session.view.result.plan


def test_it_is_served_to_this_machine_alone(studio: Studio) -> None:
    port = studio.server.get_port()
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE):
        pass
    with pytest.raises(OSError, match=r"refused|assign|reach"):
        socket.create_connection(("127.0.0.2", port), timeout=PATIENCE)  # as a server on all addresses would answer
    assert studio.server.get_host() == "127.0.0.1"


def test_only_its_own_page_may_connect(studio: Studio) -> None:
    """As a browser asks, which tells where a page comes from; and as a page does whose name was made to lead here."""
    from viser import __version__ as version
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    port = studio.server.get_port()

    def asked(host: str, origin: str | None) -> bytes | str:
        with (
            socket.create_connection(("127.0.0.1", port)) as line,
            connect(f"ws://{host}:{port}", sock=line, origin=origin, subprotocols=[f"viser-v{version}"]) as page,
        ):
            return page.recv(timeout=PATIENCE)

    for host in ("localhost", "127.0.0.1"):
        assert asked(host, f"http://{host}:{port}")
    for host, origin in (
        ("localhost", "https://elsewhere.example"),
        ("localhost", None),
        ("localhost", "null"),
        ("localhost", "http://localhost.elsewhere.example"),
        ("localhost", f"http://localhost:{port + 1}"),
        ("elsewhere.example", f"http://elsewhere.example:{port}"),
    ):
        with pytest.raises(InvalidStatus, match="403"):
            asked(host, origin)


def test_it_has_a_title_and_names_what_is_on_it(studio: Studio) -> None:
    from urllib.request import urlopen

    with urlopen(studio.address) as answer:
        page = answer.read().decode()
        assert int(answer.headers["Content-Length"]) == len(page.encode())
    assert f"<title>floatplan: {studio.session.view.problem.name}</title>" in page
    assert "aria-label" in page.partition("</script>")[0]
    assert ".fp.curves" in page
    assert titled(None, "x") is None
    for body in (
        b"<head><title>Viser</title></head>",
        b"<head><title>viser 2</title></head>",
        b'<head lang="en"></head>',
    ):
        given = SimpleNamespace(headers={"Content-Type": "text/html", "Content-Length": "0"}, body=body)
        assert titled(given, "</title>").body.count(b"<title>") == 1
        assert b"<title>&lt;/title&gt;</title>" in given.body


def request(studio: Studio, head: str, accept: str | None = None) -> bytes:
    """The status of what the page answers to a request."""
    port = studio.server.get_port()
    lines = [head, *([f"Host: localhost:{port}"] if "Host" not in head else [])]
    lines += [] if accept is None else [f"Accept-Encoding: {accept}"]
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as line:
        line.sendall("\r\n".join([*lines, "", ""]).encode())
        return line.recv(12)[9:12]


@pytest.mark.parametrize("accept", [None, "gzip", "identity", "gzip\r\nAccept-Encoding: br", ""])
def test_it_needs_no_word_of_encodings(studio: Studio, accept: str | None) -> None:
    """As of curl, which sends none, or of a proxy, which adds one."""
    assert request(studio, "GET / HTTP/1.1", accept) == b"200"
    assert request(studio, "GET /?x=1 HTTP/1.1", accept) == b"200"


@pytest.mark.parametrize(
    "path", ["/" + "a" * 300, "/" + "a" * 5000, "/a/" * 2000, "/%00", "/missing", "/..", "/assets"]
)
def test_what_no_file_has_is_no_page(studio: Studio, capfd: pytest.CaptureFixture[str], path: str) -> None:
    assert request(studio, f"GET {path} HTTP/1.1") == b"404"
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("head", "status"),
    [
        ("GET / HTTP/1.1\r\nUpgrade: websocket\r\nUpgrade: websocket\r\nOrigin: http://a\r\nOrigin: http://b", b"403"),
        ("GET / HTTP/1.1\r\nUpgrade: websocket\r\nHost: localhost\r\nHost: localhost", b"403"),
        ("GET / HTTP/1.1\r\nUpgrade: h2c", b"403"),
        ("GET /" + "a" * 20000 + " HTTP/1.1", b""),
        ("nonsense", b""),
    ],
)
def test_odd_requests_are_no_errors_of_the_program(
    studio: Studio, capfd: pytest.CaptureFixture[str], head: str, status: bytes
) -> None:
    with logged_errors() as errors:
        answer = request(studio, head)
    assert answer in (status, b"400", b"414") if status == b"" else answer == status
    assert errors == []
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("origin", ["http://[::1", "http://:80", "localhost:80", "", "http://localhost:80/", "\0"])
def test_what_is_no_origin_is_not_the_own_page(origin: str) -> None:
    assert not is_own_page(origin, "localhost:8080")
    assert is_own_page("http://localhost:8080", "localhost:8080")


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize("part", [0, 1, 2])
def test_a_drag_turns_one_joint_as_far_as_the_hand_goes(fresh: Studio, end: str, part: int) -> None:
    """Around that joint; nothing else of the posture changes."""
    before = fresh.session.view.problem
    places = grip_places(fresh, end, part, np.linspace(0.0, 0.2, 5))
    for step, place in enumerate(places):
        fresh.stage.rotate(end, part, complex(place), begins=step == 0)
    after = fresh.session.view.problem
    states = [problem.initial if end == "start" else problem.final for problem in (before, after)]
    changed = [states[1].orientation - states[0].orientation, *(states[1].positions - states[0].positions)]
    assert abs(changed[part]) == pytest.approx(0.2, abs=1e-9)
    assert [value for index, value in enumerate(changed) if index != part] == [0.0, 0.0]
    answered(fresh)


def test_a_full_turn_is_one_somersault_more(fresh: Studio) -> None:
    before = fresh.session.view.problem.goal.orientation
    places = grip_places(fresh, "goal", 0, np.linspace(0.0, 2 * np.pi, 25))
    for step, place in enumerate(places):
        fresh.stage.rotate("goal", 0, complex(place), begins=step == 0)
    turned = fresh.session.view.problem.goal.orientation - before
    assert abs(turned) == pytest.approx(2 * np.pi)


def test_a_joint_stops_at_the_end_of_its_range(fresh: Studio) -> None:
    for step, place in enumerate(grip_places(fresh, "goal", 1, np.linspace(0.0, 12.0, 120))):
        fresh.stage.rotate("goal", 1, complex(place), begins=step == 0)
    problem = fresh.session.view.problem
    assert problem.final.positions[0] in problem.position_limits[0]
    assert fresh.session.view.refusal == ""
    answered(fresh)


def test_obstacles_are_carried_and_come_and_go(fresh: Studio) -> None:
    first = fresh.session.view.problem.obstacles
    fresh.stage.carry(0, 1 + 1j, begins=True)
    for share in (0.3, 0.6, 1.0):
        fresh.stage.carry(0, 1 + 1j + share * (0.25 - 0.5j), begins=False)
    moved = fresh.session.view.problem.obstacles[0]
    assert isinstance(moved, fp.Circle)
    assert isinstance(first[0], fp.Circle)
    assert np.subtract(moved.center, first[0].center) == pytest.approx([0.25, -0.5])
    answered(fresh)
    for make in (kind.example for kind in OBSTACLE_KINDS.values()):
        fresh.session.edit(edits.with_obstacle(make(*fresh.stage.free_position())))
        answered(fresh)
    for index in (2, 0, 1, 0):
        fresh.session.edit(edits.put_obstacle(index))
        answered(fresh)
    assert fresh.session.view.problem.obstacles == ()
    fresh.stage.carry(0, 1 + 1j, begins=True)
    fresh.stage.carry(0, 2 + 1j, begins=False)


def test_obstacles_are_listed_that_are_gone_meanwhile(fresh: Studio) -> None:
    """A view is drawn of which the session has taken back what it shows."""
    answered(fresh)
    view, dials = fresh.session.view, set(fresh.panel.inputs.sliders)
    edit = edits.with_obstacle(fp.Circle(center=(9.0, 8.0), radius=0.5))
    fresh.painter.do("ahead", lambda: fresh.panel.draw(replace(view, problem=edit(view.problem))))
    assert fresh.painter.wait(PATIENCE)
    listed = {path: slider.value for path, slider in fresh.panel.inputs.sliders.items() if path not in dials}
    assert listed == {
        "obstacles.1.center.0": 9.0,
        "obstacles.1.center.1": 8.0,
        "obstacles.1.radius": 0.5,
        "obstacles.1.margin": 0.0,
    }
    fresh._repaint()
    assert fresh.painter.wait(PATIENCE)
    assert set(fresh.panel.inputs.sliders) == dials


def test_sliders_follow_the_session(fresh: Studio) -> None:
    answered(fresh)
    fresh.session.set("goal.orientation", 31.0)
    answered(fresh)
    slider = fresh.panel.inputs.sliders["goal.orientation"]
    assert slider.value == pytest.approx(np.degrees(31.0), abs=0.01)
    assert slider.max >= slider.value
    fresh.session.undo()
    answered(fresh)
    assert slider.value == pytest.approx(np.degrees(fresh.session.view.problem.goal.orientation), abs=0.01)


class Client:
    """A page that sends what a browser would, and takes what it is sent."""

    def __init__(self, studio: Studio) -> None:
        from viser import __version__ as version
        from websockets.sync.client import connect

        place = f"localhost:{studio.server.get_port()}"
        self.page = connect(
            f"ws://{place}", origin=f"http://{place}", subprotocols=[f"viser-v{version}"], max_size=None
        )
        self.reading = threading.Thread(target=lambda: list(self.page), daemon=True)  # else it is closed after 40 s
        self.reading.start()
        self.send("ViewerCameraMessage", **CAMERA)
        while not studio.server.get_clients():
            assert self.reading.is_alive()

    def send(self, kind: str, **content: Any) -> None:
        import msgspec

        self.page.send(msgspec.msgpack.encode({"type": kind, **content}))

    def set(self, handle: Any, value: Any) -> None:
        """Set what an input shows, as a user does."""
        self.send("GuiUpdateMessage", uuid=handle._impl.uuid, updates={"value": value})

    def close(self) -> None:
        self.page.close()
        self.reading.join()


def test_nobody_opens_a_way_from_elsewhere(fresh: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    """viser opens a tunnel for any client that asks; nothing leaves this machine here, as the tunnel is another."""
    asked: list[object] = []

    class Tunnel:
        def __init__(self, *where: object) -> None:
            asked.append(where)

        def get_status(self) -> str:
            return "failed"

        def __getattr__(self, name: str) -> Any:
            return lambda *_: None

    monkeypatch.setattr("viser._viser.ViserTunnel", Tunnel)
    answered(fresh)
    page = Client(fresh)
    for kind in ("ShareUrlRequest", "ShareUrlDisconnect", "ShareUrlRequest"):
        page.send(kind)
    slider = fresh.panel.inputs.sliders["flight.duration"]
    page.set(slider, 1.2)  # when this has come through, so have they
    assert fresh.session.wait(lambda view: view.problem.flight.duration == 1.2, PATIENCE)
    assert fresh.server.request_share_url() is None
    page.close()
    assert asked == []


def test_a_viser_that_shares_in_another_way_is_not_started() -> None:
    with pytest.raises(fp.InputError, match="gives out public addresses in a way that is not known"):
        unshared(SimpleNamespace(ViserServer=type("ViserServer", (), {})))


def test_nor_one_that_starts_its_server_in_another_way(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it has started is stopped."""
    made = []

    class Server:
        def __init__(self, **_: object) -> None:
            self.is_stopped = False
            made.append(self)

        def request_share_url(self) -> None:
            raise AssertionError

        def stop(self) -> None:
            self.is_stopped = True

    monkeypatch.setattr("viser.ViserServer", Server)
    with pytest.raises(fp.InputError, match="starts its server in a way that is not known"):
        Studio(fp.load_problem(ROOT / "problems" / "somersault.toml"), port=0, with_map=False)
    assert [server.is_stopped for server in made] == [True]


@pytest.fixture
def client(fresh: Studio) -> Iterator[Client]:
    answered(fresh)
    made = Client(fresh)
    yield made
    made.close()


@pytest.mark.parametrize("value", [math.nan, 1e300, -1e300, math.inf])
def test_a_number_that_no_slider_has_is_refused(fresh: Studio, client: Client, value: float) -> None:
    """As a page may send it, to every slider: a message, and nothing changes."""
    before = fresh.session.view.problem
    for slider in [fresh.panel.time, *fresh.panel.inputs.sliders.values()]:
        fresh.session.refuse("")
        client.set(slider, value)
        assert fresh.session.wait(lambda view: view.refusal != "", PATIENCE), slider.label
        assert "\n" not in fresh.session.view.refusal
        assert "np.float64" not in fresh.session.view.refusal
    assert fresh.session.view.problem is before
    frames = fresh.player.frames
    with logged_errors() as errors:
        fresh.player.playing = True
        while fresh.player.frames < frames + 3:
            assert errors == []
        fresh.player.playing = False
    fresh.session.refuse("")


def test_what_a_user_sets_is_not_lost_to_what_the_page_draws_meanwhile(
    fresh: Studio, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Drawn between viser's change of an input and its event, and again before the session has done what was asked."""
    monkeypatch.setattr("floatplan.studio.inputs.RELEASED", -1.0)
    inputs = fresh.panel.inputs
    slider = inputs.sliders["flight.duration"]
    choice = next(each.handle for each in inputs._shown if each.handle.label == "least")
    before = fresh.session.view.problem
    for handle, value in ((slider, 1.125), (choice, "torque")):

        def in_between(*_: Any) -> None:
            fresh._repaint()
            fresh.painter.wait(0.3)

        gate, came = threading.Event(), threading.Event()
        fresh.actions.do("gate", lambda gate=gate: gate.wait(PATIENCE))  # type: ignore[misc]
        monkeypatch.setattr(handle._impl, "sync_cb", in_between)
        handle.on_update(lambda event, came=came: came.set() if event.client else None)
        client.set(handle, value)
        assert came.wait(PATIENCE)
        fresh._repaint()
        assert fresh.painter.wait(PATIENCE)
        gate.set()
        assert fresh.actions.wait(PATIENCE)
        handle._impl.update_cb.pop()
    problem = fresh.session.view.problem
    assert (problem.flight.duration, problem.motion.objective) == (1.125, "torque")
    assert before.motion.objective != "torque"
    answered(fresh)
    assert (slider.value, choice.value) == (1.125, "torque")


def test_two_plans_fly_side_by_side(fresh: Studio) -> None:
    answered(fresh)
    fresh.session.keep()
    fresh.session.set("flight.duration", 1.3)
    answered(fresh)
    view = fresh.session.view
    assert len(fresh.stage.shows(view)) == 2
    assert fresh.stage.compared.root.visible
    fresh.session.keep(False)
    answered(fresh)
    assert not fresh.stage.compared.root.visible


def test_the_player_goes_on_stops_and_seeks(fresh: Studio) -> None:
    plan = answered(fresh)
    fresh.player.seek(0.5 * plan.duration)
    fresh.painter.wait(PATIENCE)
    sent = fresh.player.frames
    with logged_errors() as errors:
        fresh.player.playing = True
        while fresh.player.frames < sent + 10:
            assert errors == []
        fresh.player.playing = False


def test_rays_meet_the_plane(gymnast: fp.Robot) -> None:
    plane = gymnast.plane
    eye = 3.0 * np.cross(plane.horizontal, plane.vertical) + 0.4 * plane.vertical
    for place in (0.3 - 0.7j, 2.0 + 0j, 0j):
        point = world_points(plane, np.array([place]))[0]
        met = plane_position(plane, eye, eye + 0.37 * (point - eye))
        assert met == pytest.approx(place)
    assert plane_position(plane, eye, eye + plane.horizontal) is None


class Recorded:
    """A scene that keeps what it is given."""

    def __init__(self) -> None:
        self.nodes: dict[str, Any] = {}
        self.scene = self

    def add_frame(self, name: str, **_: Any) -> Any:
        return self.nodes.setdefault(name, type("Frame", (), {"position": np.zeros(3), "wxyz": np.eye(4)[0]})())

    def add_mesh_simple(self, name: str, vertices: Any, faces: Any, color: Any) -> None:
        self.nodes[name] = vertices


SMALL = 0.02  # [m] robot, so that nothing of its meshes is coarser than 0.1 mm


def test_meshes_are_where_the_urdf_has_them() -> None:
    """Against yourdfpy's own kinematics, with the base turned and every joint somewhere else."""
    import trimesh
    from scipy.spatial import cKDTree

    from floatplan.view.outlines import body_poses
    from floatplan.view.scene.meshes import joint_angles, visual_model
    from floatplan.view.scene.scene import DETAIL

    if robots_folder() is None:
        skip_or_fail("example-robot-data is not installed: the extra robots")
    robot = fp.load_problem(ROOT / "problems" / "gallery" / "go2.toml").robot
    scene = Recorded()
    bodies = RobotNodes(scene, "/robot", robot)
    assert bodies.add_meshes(SMALL, share=1.0)
    rng = np.random.default_rng(0)
    low, high = robot.position_limits.T
    positions, orientation = rng.uniform(low, high), 0.7
    poses = body_poses(robot, np.array([orientation]), positions[None], np.array([0.2 + 0.1j]))
    bodies.put(poses, 0)
    model = visual_model(robot)
    angles = joint_angles(robot, positions)
    model.update_cfg(np.array([angles[name] for name in model.actuated_joint_names]))
    root = scene.nodes["/robot/0"]
    base = trimesh.transformations.quaternion_matrix(root.wxyz)
    base[:3, 3] = root.position
    drawn = []
    for name in (name for name in scene.nodes if "/links" in name):
        frame = scene.nodes[name.rpartition("/")[0]]
        pose = trimesh.transformations.quaternion_matrix(frame.wxyz)
        pose[:3, 3] = frame.position
        drawn.append(trimesh.transform_points(scene.nodes[name], pose))
    expected = [
        trimesh.transform_points(mesh.vertices, base @ model.get_transform(geometry))
        for geometry, mesh in model.scene.geometry.items()
    ]
    there, here = np.concatenate(expected), np.concatenate(drawn)
    for places, others in ((there, here), (here, there)):
        assert cKDTree(others).query(places)[0].max() < np.sqrt(3) * DETAIL * SMALL


def test_without_viser_there_is_one_clear_error(
    monkeypatch: pytest.MonkeyPatch, floatplan: Callable[..., Any], root: Path
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "viser", None)
    done = floatplan("studio", root / "problems" / "somersault.toml")
    assert done.code == 2
    assert done.stderr.startswith("error: studio: viser is not installed")
    assert '"view"' in done.stderr
    assert "pip install" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_problem_that_is_wrong_ends_it_with_its_error(floatplan: Callable[..., Any]) -> None:
    done = floatplan("studio", "nowhere.toml")
    assert done.code == 2
    assert "nowhere.toml" in done.stderr
