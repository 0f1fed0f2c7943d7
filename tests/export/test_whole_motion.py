"""Exports of the whole motion, base and all joints: each read back by the programs that it is for."""

import sys

import numpy as np
import pinocchio as pin
import pytest
from mcap.reader import make_reader
from robot_samples import TWO_LINKS

import floatplan as fp
from floatplan.errors import InputError
from floatplan.export.formats import FORMATS, export


@pytest.fixture(params=["coupled", "tree"])
def plan(request):
    return request.getfixturevalue(request.param)


def free_model(plan):
    model = pin.buildModelFromUrdf(str(plan.robot.path), pin.JointModelFreeFlyer())
    return model, model.createData()


def messages(path):
    """Messages by topic, as the ROS 2 reader of MCAP decodes them."""
    found = {}
    for message in pytest.importorskip("mcap_ros2.reader").read_ros2_messages(str(path)):
        found.setdefault(message.channel.topic, []).append(message)
    return found


def seconds(message):
    return message.log_time_ns / 1e9


def test_mcap_is_a_ros_2_bag(plan, tmp_path):
    path = export(plan, "mcap", tmp_path / "flight.mcap")
    with path.open("rb") as stream:
        bag = make_reader(stream)
        assert bag.get_header().profile == "ros2"
        summary = bag.get_summary()
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    qualities = {channel.topic: channel.metadata["offered_qos_profiles"] for channel in summary.channels.values()}
    kept = {topic for topic, text in qualities.items() if "durability: 1" in text}
    assert kept == {"/robot_description", "/tf_static"}
    found = messages(path)
    assert found["/robot_description"][0].ros_msg.data == plan.robot.xml
    assert len(found["/tf"]) == len(found["/joint_states"]) == 81


def pose(transform):
    place, turn = transform.translation, transform.rotation
    rotation = pin.Quaternion(turn.w, turn.x, turn.y, turn.z).matrix()
    return pin.SE3(rotation, np.array([place.x, place.y, place.z]))


def test_mcap_places_every_link_where_pinocchio_has_it(plan, tmp_path):
    found = messages(export(plan, "mcap", tmp_path / "flight.mcap"))
    model, data = free_model(plan)
    static = list(found["/tf_static"][0].ros_msg.transforms)
    for message in found["/tf"][::20]:
        placed = {"world": pin.SE3.Identity()}
        waiting = [*message.ros_msg.transforms, *static]
        while waiting:
            ready = [each for each in waiting if each.header.frame_id in placed]
            assert ready, [each.child_frame_id for each in waiting]
            for each in ready:
                assert each.child_frame_id not in placed
                placed[each.child_frame_id] = placed[each.header.frame_id] * pose(each.transform)
            waiting = [each for each in waiting if each.child_frame_id not in placed]
        assert set(placed) == {"world", *plan.robot.file_tree.links}
        pin.framesForwardKinematics(model, data, plan.q(min(seconds(message), plan.duration)))
        for link in plan.robot.file_tree.links:
            expected = data.oMf[model.getFrameId(link, pin.FrameType.BODY)]
            assert np.abs(placed[link].homogeneous - expected.homogeneous).max() < 1e-8, link


@pytest.mark.parametrize(
    ("form", "module"), [("mcap", "mcap.writer"), ("mcap", "mcap_ros2._dynamic"), ("parquet", "pyarrow")]
)
def test_what_is_missing_is_named(coupled, tmp_path, monkeypatch, form, module):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=rf"pip install .*\[{form}\]"):
        export(coupled, form, tmp_path / "file")
    assert not list(tmp_path.iterdir())


def test_the_command_s_help_tells_of_every_format(floatplan):
    text = floatplan("export", "--help").stdout
    for form in FORMATS:
        assert f"\n  {form:<11}" in text, text


def test_a_rotor_alone_is_no_obstacle(flown, tmp_path):
    """Pinocchio refuses ``<dynamics>`` without damping and friction: the coordinates are the same."""
    path = tmp_path / "rotor.urdf"
    path.write_text(TWO_LINKS.replace("</joint>", '<dynamics armature="0.01"/></joint>'))
    plan = flown(fp.Robot.from_urdf(path))
    np.testing.assert_array_equal(plan.q(0.4)[7:], plan.at(0.4).positions)
    np.testing.assert_array_equal(plan.v(0.4)[6:], plan.at(0.4).velocities)
