"""Capsules hold the collision geometry that they stand for, and hold it tightly."""

import math

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from long_cases import cases
from robot_samples import RandomTree, inertial, joint

import floatplan as fp
from floatplan.errors import InputError
from floatplan.robot import Robot
from floatplan.robot.shapes.capsules import Outline, PlaneCapsule, fit, fit_capsule


def cloud(seed, count=60):
    generator = np.random.default_rng(seed)
    stretch = generator.uniform(0.01, 1.0)
    turn = np.exp(1j * generator.uniform(0, 2 * np.pi))
    return turn * (generator.normal(size=count) + 1j * stretch * generator.normal(size=count)) + generator.normal()


def brute_force_area(points):
    """Least area over fine directions and radii, by plain loops."""
    best = math.inf
    for angle in np.linspace(0, np.pi, 240, endpoint=False):
        turned = points * np.exp(-1j * angle)
        middle = (turned.imag.max() + turned.imag.min()) / 2
        offset = turned.imag - middle
        for radius in np.linspace(abs(offset).max(), abs(points[:, None] - points[None, :]).max(), 60):
            reach = np.sqrt(np.maximum(radius**2 - offset**2, 0))
            length = max((turned.real - reach).max() - (turned.real + reach).min(), 0.0)
            best = min(best, np.pi * radius**2 + 2 * radius * length)
    return best


@pytest.mark.parametrize("seed", cases(range(8), range(3, 8)))
def test_capsule_holds_its_points_and_has_nearly_least_area(seed):
    points = cloud(seed)
    capsule = fit_capsule(points, 0.1)
    assert capsule.depth(points).min() >= 0.1 - 1e-12
    bare = fit_capsule(points)
    assert bare.depth(points).min() >= -1e-12
    assert bare.area <= 1.03 * brute_force_area(points)


def test_bent_shapes_are_split_and_straight_ones_are_not():
    across = np.linspace(-0.05, 0.05, 3)
    arm = (np.linspace(0, 1, 40)[:, None] + 1j * across).ravel()
    elbow = np.concatenate([arm, 1j * arm])
    near = abs(elbow[:, None] - elbow[None, :]) < 0.06
    edges = np.argwhere(np.triu(near, 1))
    capsules = fit(Outline(elbow, edges))
    assert 2 <= len(capsules) <= 4
    assert sum(capsule.area for capsule in capsules) < 0.6 * fit_capsule(elbow).area
    middles = (elbow[edges[:, 0]] + elbow[edges[:, 1]]) / 2
    for points in (elbow, middles):
        assert np.max([capsule.depth(points) for capsule in capsules], axis=0).min() > -1e-12
    assert len(fit(Outline.convex(arm))) == 1


@pytest.mark.parametrize("seed", range(6))
def test_every_point_of_a_triangle_soup_is_in_a_capsule(seed):
    """Long triangles that are cut more than once: their insides must not get lost between the parts."""
    generator = np.random.default_rng(seed)
    places = generator.uniform(0, 3, 12)
    corners = places[:, None] * np.exp(1j * np.where(places < 1.5, 0, 0.9))[:, None]
    corners = corners + generator.normal(scale=0.1, size=(12, 3)) + 1j * generator.normal(scale=0.1, size=(12, 3))
    corners[0, 1] = corners[1, 0] + 0.5
    numbers = np.arange(36).reshape(12, 3)
    edges = np.concatenate([numbers[:, [0, 1]], numbers[:, [1, 2]], numbers[:, [2, 0]]])
    capsules = fit(Outline(corners.ravel(), edges, 0.02))
    inside = np.einsum("kj,ij->ik", generator.dirichlet((0.5, 0.5, 0.5), 400), corners).ravel()
    assert np.max([capsule.depth(inside) for capsule in capsules], axis=0).min() > 0.02 - 1e-12


GEOMETRIES = {
    "sphere": '<sphere radius="0.13"/>',
    "box": '<box size="0.4 0.1 0.06"/>',
    "cylinder": '<cylinder radius="0.05" length="0.5"/>',
    "flat cylinder": '<cylinder radius="0.3" length="0.02"/>',
    "capsule": '<capsule radius="0.05" length="0.5"/>',
    "mesh": '<mesh filename="package://meshes/part.stl" scale="0.5 1 2"/>',
}


def part():
    """An angle of two bars: a shape that is worth more than one capsule."""
    bars = trimesh.creation.box((1.0, 0.1, 0.1)), trimesh.creation.box((0.1, 0.1, 1.0))
    bars[1].apply_translation((0.45, 0.0, 0.45))
    return trimesh.util.concatenate(bars)


def surface(kind):
    """Points (k, 3) on and in a geometry, in its own frame."""
    if kind == "sphere":
        return trimesh.creation.icosphere(3, 0.13).vertices
    if kind == "box":
        return trimesh.sample.volume_rectangular((0.4, 0.1, 0.06), 400)
    if kind == "capsule":
        return trimesh.creation.capsule(0.5, 0.05).vertices
    if kind == "mesh":
        mesh = trimesh.load_mesh(trimesh.util.wrap_as_stream(part().export(file_type="stl")), file_type="stl")
        middles = mesh.vertices[mesh.edges_unique].mean(axis=1)
        return np.concatenate([mesh.vertices, middles, mesh.triangles_center]) * (0.5, 1, 2)
    radius, length = (0.05, 0.5) if kind == "cylinder" else (0.3, 0.02)
    return trimesh.creation.cylinder(radius, length, sections=64).vertices


def robot_with(tmp_path, geometry, seed=0, more=""):
    """A random robot whose every link has the geometry, each at its own place."""
    (tmp_path / "meshes").mkdir(exist_ok=True)
    part().export(tmp_path / "meshes" / "part.stl")
    tree = RandomTree(seed, joints=5)
    generator = np.random.default_rng(seed)
    text, origins = tree.text, {}
    for number in range(6):
        origins[f"link{number}"] = generator.uniform(-1, 1, 6)
        xyz, rpy = (" ".join(map(str, values)) for values in np.split(origins[f"link{number}"], 2))
        collision = f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry></collision>'
        text = text.replace(f'<link name="link{number}">', f'<link name="link{number}">{collision}{more}')
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    return Robot.from_urdf(path, plane="xz", locked=tree.locked), origins


@pytest.mark.parametrize("kind", GEOMETRIES)
@pytest.mark.parametrize("seed", [0, 1])
def test_geometry_is_inside_its_capsules_at_every_posture(tmp_path, kind, seed):
    robot, origins = robot_with(tmp_path, GEOMETRIES[kind], seed)
    points = surface(kind)
    data, generator = robot.model.createData(), np.random.default_rng(9)
    for _ in range(3):
        positions, orientation = generator.uniform(-3, 3, len(robot.joints)), generator.uniform(-9, 9)
        full = robot.reference + robot.selection @ positions
        full[2] = orientation
        pin.framesForwardKinematics(robot.model, data, full)
        com = pin.centerOfMass(robot.model, data, full)
        rotations = robot.tree.rotations(robot.tree.absolute_angles(np.array(orientation), positions))
        for link, origin in origins.items():
            own = [shape for shape in robot.shapes if shape.link == link]
            assert own
            frame = data.oMf[robot.model.getFrameId(link)]
            placed = frame * pin.SE3(pin.rpy.rpyToMatrix(origin[3:]), origin[:3])
            world = points @ placed.rotation.T + placed.translation - com
            seen = world @ robot.plane.horizontal + 1j * (world @ robot.plane.vertical)
            body = np.array([shape.body for shape in own])
            starts = rotations @ robot.tree.point_weights(body, np.array([shape.start for shape in own])).T
            ends = rotations @ robot.tree.point_weights(body, np.array([shape.end for shape in own])).T
            capsules = [
                PlaneCapsule(complex(start), complex(end), shape.radius)
                for start, end, shape in zip(starts, ends, own, strict=True)
            ]
            assert np.max([capsule.depth(seen) for capsule in capsules], axis=0).min() > -1e-9


def one_link(tmp_path, collision):
    path = tmp_path / "robot.urdf"
    links = f'<link name="a">{inertial()}{collision}</link><link name="b">{inertial()}</link>'
    path.write_text(f'<robot name="r">{links}{joint("j", "a", "b")}</robot>')
    return Robot.from_urdf(path)


def in_plane(geometry, rpy="0 0 0"):
    return f'<collision><origin xyz="0.1 0.7 0.2" rpy="{rpy}"/><geometry>{geometry}</geometry></collision>'


def test_links_without_usable_collision_remain_segments(tmp_path):
    robot = one_link(tmp_path, in_plane('<mesh filename="nowhere.stl"/>'))
    assert 'link "a": collision mesh "nowhere.stl" not found' in robot.warnings[0]
    assert [shape.link for shape in robot.shapes] == ["a", "b"]
    assert [shape.end for shape in robot.shapes] == pytest.approx([0.3, 0.0], abs=1e-15)
    assert [shape.radius for shape in robot.shapes] == [0.0, 0.0]
    assert one_link(tmp_path, "<collision/>").shapes[0].end == pytest.approx(0.3, abs=1e-15)
    assert one_link(tmp_path, in_plane("<cone/>")).shapes[0].end == pytest.approx(0.3, abs=1e-15)


def test_clearance_of_a_robot_without_its_meshes_is_refused(tmp_path):
    robot = one_link(tmp_path, in_plane('<mesh filename="nowhere.stl"/>'))
    asked = {
        "start": fp.Posture(0.0, [0.1]),
        "goal": fp.Posture(0.4, [0.5]),
        "flight": fp.Flight(duration=0.5, takeoff=fp.Takeoff("a")),
    }
    assert fp.Problem(robot, **asked).obstacles == ()
    wanted = (
        {"obstacles": (fp.Circle(center=(3.0, 3.0), radius=0.1),)},
        {"self_clearances": (fp.SelfClearance(links=("a", "b")),)},
    )
    for clearance in wanted:
        with pytest.raises(InputError, match=r"clearance cannot be computed") as caught:
            fp.Problem(robot, **asked, **clearance)
        assert caught.value.element == 'link "a"'


@pytest.mark.parametrize("geometry", ["<cone/>", '<sphere radius="0.1"/><box size="9 9 9"/>'])
def test_clearance_of_a_robot_with_geometry_that_is_not_read_is_refused(tmp_path, geometry):
    robot = one_link(tmp_path, in_plane(geometry))
    obstacles = (fp.Circle(center=(3.0, 3.0), radius=0.1),)
    flight = fp.Flight(duration=0.5, takeoff=fp.Takeoff("a"))
    with pytest.raises(InputError, match="is not read") as caught:
        fp.Problem(robot, start=fp.Posture(0.0, [0.1]), goal=fp.Posture(0.4, [0.5]), flight=flight, obstacles=obstacles)
    assert caught.value.element == 'link "a"'


WRONG = {
    "negative radius": ('<sphere radius="-0.1"/>', 'link "a": collision: sphere: radius', "negative"),
    "text": ('<cylinder radius="wide" length="1"/>', 'link "a": collision: cylinder: radius', "must be a number"),
    "missing length": ('<cylinder radius="1"/>', 'link "a": collision: cylinder', "has no length"),
    "negative box": ('<box size="1 -1 1"/>', 'link "a": collision: box: size', "negative"),
    "NaN scale": ('<mesh filename="part.stl" scale="nan 1 1"/>', 'link "a": collision: mesh: scale', "number"),
    "not a mesh": ('<mesh filename="part.stl"/>', 'link "a": collision: mesh', "mesh"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_geometry_is_refused(tmp_path, name):
    geometry, element, reason = WRONG[name]
    (tmp_path / "part.stl").write_text("this is not a mesh")
    robot = one_link(tmp_path, in_plane(geometry))
    with pytest.raises(InputError) as caught:
        _ = robot.shapes
    assert caught.value.element == element
    assert reason in caught.value.reason
    assert caught.value.source.endswith((".urdf", ".stl"))


def test_mesh_files_are_found_where_ros_would_look(tmp_path, monkeypatch):
    mesh = trimesh.creation.icosphere(1, 0.2)
    for place in ("mine/share/pack/part.stl", "ros/pack/part.stl", "near.stl"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        mesh.export(tmp_path / place)
    (tmp_path / "urdf").mkdir()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "mine"))
    names = ["package://pack/part.stl", "../near.stl", f"file://{tmp_path}/near.stl", str(tmp_path / "near.stl")]
    for name in names:
        robot = one_link(tmp_path / "urdf", in_plane(f'<mesh filename="{name}"/>'))
        assert robot.warnings == ()
        assert robot.shapes[0].radius == pytest.approx(0.2, rel=0.1)
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    assert one_link(tmp_path / "urdf", in_plane(f'<mesh filename="{names[0]}"/>')).warnings
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    assert not one_link(tmp_path / "urdf", in_plane(f'<mesh filename="{names[0]}"/>')).warnings
