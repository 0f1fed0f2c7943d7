"""The page without a browser: served to this machine alone, dragged, and drawn."""

import math
import socket
import threading
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest
from places import ROOT
from studio_insides import logged_errors
from studio_page import grip_places

import floatplan as fp
from floatplan.problem.parts import OBSTACLE_KINDS
from floatplan.studio import edits
from floatplan.studio.page import Studio, titled

PATIENCE = 600.0  # s for what takes a fraction of one, and lets others go first


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    problem = fp.load_problem(ROOT / "problems" / "obstacle.toml")
    folder = str(tmp_path_factory.mktemp("saved"))
    with logged_errors() as errors, closing(Studio(problem, folder=folder, port=0, with_map=False)) as made:
        yield made
    assert errors == []


@pytest.fixture
def fresh(studio):
    """The studio with its first problem."""
    while studio.session.undo():
        pass
    return studio


CAMERA = {
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


def answered(studio):
    assert studio.session.wait(lambda view: view.is_current, PATIENCE)
    assert studio.painter.wait(PATIENCE)
    return studio.session.view.result.plan


def test_it_is_served_to_this_machine_alone(studio):
    port = studio.server.get_port()
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE):
        pass
    with pytest.raises(OSError, match=r"refused|assign|reach"):
        socket.create_connection(("127.0.0.2", port), timeout=PATIENCE)  # as a server on all addresses would answer
    assert studio.server.get_host() == "127.0.0.1"


def test_only_its_own_page_may_connect(studio):
    """As a browser asks, which tells where a page comes from; and as a page does whose name was made to lead here."""
    from viser import __version__ as version
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    port = studio.server.get_port()

    def asked(host, origin):
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


def test_it_has_a_title_and_names_what_is_on_it(studio):
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


@pytest.mark.parametrize("end", ["start", "goal"])
@pytest.mark.parametrize("part", [0, 1, 2])
def test_a_drag_turns_one_joint_as_far_as_the_hand_goes(fresh, end, part):
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


def test_obstacles_are_carried_and_come_and_go(fresh):
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


class Client:
    """A page that sends what a browser would, and takes what it is sent."""

    def __init__(self, studio):
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

    def send(self, kind, **content):
        import msgspec

        self.page.send(msgspec.msgpack.encode({"type": kind, **content}))

    def set(self, handle, value):
        """Set what an input shows, as a user does."""
        self.send("GuiUpdateMessage", uuid=handle._impl.uuid, updates={"value": value})

    def close(self):
        self.page.close()
        self.reading.join()


def test_nobody_opens_a_way_from_elsewhere(fresh, monkeypatch):
    """viser opens a tunnel for any client that asks; nothing leaves this machine here, as the tunnel is another."""
    asked = []

    class Tunnel:
        def __init__(self, *where):
            asked.append(where)

        def get_status(self):
            return "failed"

        def __getattr__(self, name):
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


@pytest.fixture
def client(fresh):
    answered(fresh)
    made = Client(fresh)
    yield made
    made.close()


@pytest.mark.parametrize("value", [math.nan, 1e300, -1e300, math.inf])
def test_a_number_that_no_slider_has_is_refused(fresh, client, value):
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


def test_without_viser_there_is_one_clear_error(monkeypatch, floatplan, root):
    import sys

    monkeypatch.setitem(sys.modules, "viser", None)
    done = floatplan("studio", root / "problems" / "somersault.toml")
    assert done.code == 2
    assert done.stderr.startswith("error: studio: viser is not installed")
    assert '"view"' in done.stderr
    assert "pip install" in done.stderr
    assert done.stderr.count("\n") == 1
