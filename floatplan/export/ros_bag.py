"""MCAP, as a ROS 2 bag: Foxglove opens it as it is, and ``ros2 bag play`` plays it.

Messages are CDR with ROS 2's own definitions, since these are what both read: a ROS 2 bag must hold CDR, and
Foxglove, which takes JSON too, shows a robot from the standard messages. Written with the package ``mcap``.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import InputError, import_optional
from floatplan.export.table import whole_nanoseconds
from floatplan.motion.planar.full_model import FullMotion
from floatplan.plans.plan import Plan

WORLD = "world"  # the frame that the root link flies in; "world_" where a link is called so
MOST_TRANSFORMS = 1_000_000  # [-] moving links times instants: below 200 MB

HEADER = "std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id"
TIME = "builtin_interfaces/Time", "int32 sec\nuint32 nanosec"
VECTOR = "geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z"
QUATERNION = "geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"
TRANSFORM = "geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
STAMPED = (
    "geometry_msgs/TransformStamped",
    "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
)
TRANSFORMS = (
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/TransformStamped[] transforms",
    (STAMPED, HEADER, TIME, TRANSFORM, VECTOR, QUATERNION),
)
JOINT_STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
LATCHED = """- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""  # kept for who listens later (transient local), as tf2 and RViz ask of these topics; numbers are of the RMW's enums

TOPICS = {  # topic -> type, definition, types that it uses, whether its last message is kept for later listeners
    "/robot_description": ("std_msgs/msg/String", "string data", (), True),
    "/tf_static": (*TRANSFORMS, True),
    "/tf": (*TRANSFORMS, False),
    "/joint_states": ("sensor_msgs/msg/JointState", JOINT_STATE, (HEADER, TIME), False),
}


def mcap_content(plan: Plan, rate: float) -> bytes:
    """Return a ROS 2 bag: ``/robot_description``, ``/tf_static``, ``/tf``, ``/joint_states``; time begins at takeoff.

    The frame ``world`` has the root link's axes at orientation 0; ``/tf`` has the root link in it, and every link that
    a joint moves in its parent; links that are fixed are in ``/tf_static``. Efforts are the motors' own torques.

    Raises
    ------
    InputError
        The package mcap is not installed, or the rate is wrong.
    """
    writers = import_optional("mcap.writer", name="the package mcap", element="format", extra="mcap")
    tree = plan.robot.file_tree
    nanoseconds = whole_nanoseconds(plan, rate)
    moving = sum(joint.moves for joint in tree.joints)
    if len(nanoseconds) * moving > MOST_TRANSFORMS:
        reason = f"{rate} Hz for {plan.duration} s are more than {MOST_TRANSFORMS} transforms"
        raise InputError(reason, element="rate", advice="give a lower rate")
    motion = plan.full_motion(nanoseconds / 1e9)
    transforms = _Transforms(plan, motion)
    stream = io.BytesIO()
    writer = writers.Writer(stream)
    writer.start(profile="ros2", library="floatplan")
    channels = {topic: _channel(writer, topic) for topic in TOPICS}

    def write(topic: str, instant: int, message: _Cdr) -> None:
        writer.add_message(channels[topic], instant, message.content(), instant)

    write("/robot_description", 0, _Cdr().text(plan.robot.xml))
    write("/tf_static", 0, transforms.static())
    for index, instant in enumerate(nanoseconds.tolist()):
        write("/tf", instant, transforms.moving(index, instant))
        write("/joint_states", instant, _joint_state(motion, index, instant))
    writer.finish()
    return stream.getvalue()


def _channel(writer: Any, topic: str) -> int:
    """Begin a topic."""
    name, fields, uses, kept = TOPICS[topic]
    rule = "=" * 80
    text = "\n".join([fields, *(f"{rule}\nMSG: {used}\n{definition}" for used, definition in uses)])
    schema = writer.register_schema(name, "ros2msg", text.encode())
    return int(writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": LATCHED if kept else ""}))


class _Cdr:
    """A message in little-endian CDR: numbers aligned to their size, sequences and texts after their length."""

    def __init__(self) -> None:
        self._data = bytearray()

    def _align(self, size: int) -> None:
        self._data += bytes(-len(self._data) % size)

    def numbers(self, form: str, *values: int) -> _Cdr:
        """Integers of four bytes: ``i`` signed, ``I`` not."""
        self._align(4)
        self._data += struct.pack(f"<{form}", *values)
        return self

    def stamp(self, instant: int) -> _Cdr:
        return self.numbers("iI", instant // 10**9, instant % 10**9)

    def text(self, text: str) -> _Cdr:
        encoded = text.encode() + b"\0"
        self.numbers("I", len(encoded))
        self._data += encoded
        return self

    def texts(self, texts: Sequence[str]) -> _Cdr:
        self.numbers("I", len(texts))
        for text in texts:
            self.text(text)
        return self

    def floats(self, values: Array) -> _Cdr:
        """So many numbers of eight bytes, without their count."""
        self._align(8)
        self._data += np.asarray(values, dtype="<f8").tobytes()
        return self

    def sequence(self, values: Array) -> _Cdr:
        self.numbers("I", len(values))
        return self.floats(values) if len(values) else self

    def content(self) -> bytes:
        return b"\x00\x01\x00\x00" + bytes(self._data)


def _joint_state(motion: FullMotion, index: int, instant: int) -> _Cdr:
    message = _Cdr().stamp(instant).text("").texts(motion.joints)
    for values in (motion.positions, motion.velocities, motion.motor_torques):
        message.sequence(values[index])
    return message


class _Transforms:
    """Where links are in their parents."""

    def __init__(self, plan: Plan, motion: FullMotion) -> None:
        tree = plan.robot.file_tree
        column = {name: index for index, name in enumerate(motion.joints)}
        self._fixed = [joint for joint in tree.joints if not joint.moves]
        self._moving = [(joint, motion.positions[:, column[joint.name]]) for joint in tree.joints if joint.moves]
        self._root, self._motion = tree.root, motion
        self._world = WORLD
        while self._world in tree.links:
            self._world += "_"

    def static(self) -> _Cdr:
        message = _Cdr().numbers("I", len(self._fixed))
        for joint in self._fixed:
            _placed(message, 0, joint.parent, joint.child, pin.SE3ToXYZQUAT(joint.origin.placement))
        return message

    def moving(self, index: int, instant: int) -> _Cdr:
        message = _Cdr().numbers("I", len(self._moving) + 1)
        base = np.concatenate((self._motion.base_position[index], self._motion.base_quaternion[index]))
        _placed(message, instant, self._world, self._root, base)
        for joint, positions in self._moving:
            place = joint.origin.placement * joint.motion(float(positions[index]))
            _placed(message, instant, joint.parent, joint.child, pin.SE3ToXYZQUAT(place))
        return message


def _placed(message: _Cdr, instant: int, parent: str, child: str, place: Array) -> None:
    """Add a ``TransformStamped``; ``place`` (7,) is x, y, z, quaternion x, y, z, w."""
    message.stamp(instant).text(parent).text(child).floats(place)
