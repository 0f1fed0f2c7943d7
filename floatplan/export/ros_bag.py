"""MCAP, as a ROS 2 bag: Foxglove opens it as it is, and ``ros2 bag play`` plays it.

Messages are CDR with ROS 2's own definitions, since these are what both read: a ROS 2 bag must hold CDR, and
Foxglove, which takes JSON too, shows a robot from the standard messages. Written with the package ``mcap``, encoded
by ``mcap-ros2-support``, whose own writer cannot store messages for later listeners.
"""

import io
import re
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from floatplan.arrays import Array
from floatplan.errors import import_optional
from floatplan.export.motion import Exported
from floatplan.export.table import check_size, whole_nanoseconds

HEADER = "std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id"
TIME = "builtin_interfaces/Time", "int32 sec\nuint32 nanosec"
VECTOR = "geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z"
TRANSFORMS = (
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/TransformStamped[] transforms",
    (
        (
            "geometry_msgs/TransformStamped",
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
        ),
        HEADER,
        TIME,
        ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"),
        VECTOR,
        ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w"),
    ),
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
"""  # stored for later listeners (transient local), as tf2 and RViz require; numbers are the RMW's enums

# type, definition, types that it uses, whether its last message is stored for later listeners
Topic: TypeAlias = tuple[str, str, tuple[tuple[str, str], ...], bool]
TOPICS: dict[str, Topic] = {
    "/robot_description": ("std_msgs/msg/String", "string data", (), True),
    "/tf_static": (*TRANSFORMS, True),
    "/tf": (*TRANSFORMS, False),
    "/joint_states": ("sensor_msgs/msg/JointState", JOINT_STATE, (HEADER, TIME), False),
}


def mcap_content(exported: Exported, rate: float) -> bytes:
    """Return a ROS 2 bag: ``/robot_description``, ``/tf_static``, ``/tf``, ``/joint_states``; time begins at the start.

    The frame ``world`` has the root link's axes at orientation 0; ``/tf`` has the root link in it, and every link that
    a joint moves in its parent; links that are fixed are in ``/tf_static``. Efforts are the motors' own torques.
    Where there are contacts, ``/phase`` counts from 0, ``/contacts/POINT/stands`` says whether a point does, and
    ``/contacts/POINT/force`` is the force on it, N, along the axes of ``world``. ``/gains`` are a row of stiffness and
    one of damping, N m/rad and N m s/rad, of the joints in the order of ``/joint_states``.

    Raises
    ------
    InputError
        The packages mcap and mcap-ros2-support are not installed, or the rate is wrong.
    """
    writers = import_optional("mcap.writer", name="the package mcap", element="format", extra="mcap")
    tree = exported.robot.file_tree
    nanoseconds = whole_nanoseconds(exported.duration, rate)
    fixed = [joint for joint in tree.joints if not joint.moves]
    moving = [joint for joint in tree.joints if joint.moves]
    check_size(len(nanoseconds), len(moving), rate)
    times = nanoseconds / 1e9
    motion = exported.at(times)
    world = "world"  # the frame that the root link flies in; "world_" where a link has that name
    while world in tree.links:
        world += "_"
    stream = io.BytesIO()
    writer = writers.Writer(stream)
    writer.start(profile="ros2", library="floatplan")
    write = {topic: _topic(writer, topic, kind) for topic, kind in TOPICS.items()}
    write["/robot_description"](0, {"data": exported.robot.xml})
    fixed_poses = [(joint, pin.SE3ToXYZQUAT(joint.origin.placement)) for joint in fixed]
    fixed_transforms = [_transform(0, joint.parent, joint.child, pose) for joint, pose in fixed_poses]
    write["/tf_static"](0, {"transforms": fixed_transforms})
    bases = np.concatenate((motion.base_position, motion.base_quaternion), axis=1)
    columns = [exported.joints.index(joint.name) for joint in moving]
    for index, instant in enumerate(nanoseconds.tolist()):
        transforms = [_transform(instant, world, tree.root, bases[index])]
        for joint, position in zip(moving, motion.positions[index, columns].tolist(), strict=True):
            pose = pin.SE3ToXYZQUAT(joint.origin.placement * joint.motion(position))
            transforms.append(_transform(instant, joint.parent, joint.child, pose))
        write["/tf"](instant, {"transforms": transforms})
        state = {
            "header": _header(instant, ""),
            "name": list(exported.joints),
            "position": motion.positions[index].tolist(),
            "velocity": motion.velocities[index].tolist(),
            "effort": motion.motor_torques[index].tolist(),
        }
        write["/joint_states"](instant, state)
    contacts = exported.contacts(times)
    if contacts:
        _write_contacts(writer, contacts, nanoseconds.tolist(), world)
    if exported.gains is not None:
        count = len(exported.joints)
        layout = [
            {"label": "kp, kd", "size": 2, "stride": 2 * count},
            {"label": "joint", "size": count, "stride": count},
        ]
        content = {"layout": {"dim": layout, "data_offset": 0}, "data": exported.gains.ravel().tolist()}
        numbers = (
            "std_msgs/MultiArrayLayout layout\nfloat64[] data",
            (
                ("std_msgs/MultiArrayLayout", "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset"),
                ("std_msgs/MultiArrayDimension", "string label\nuint32 size\nuint32 stride"),
            ),
        )
        _topic(writer, "/gains", ("std_msgs/msg/Float64MultiArray", *numbers, True))(0, content)
    writer.finish()
    return stream.getvalue()


def _write_contacts(writer: Any, contacts: Mapping[str, Any], instants: list[int], world: str) -> None:
    """Write the contacts, and the forces, at instants, ns."""
    phase = _topic(writer, "/phase", ("std_msgs/msg/Int32", "int32 data", (), False))
    definition = "std_msgs/Header header\ngeometry_msgs/Vector3 vector"
    points = []
    for name in contacts["contact_names"]:
        topic = "/contacts/" + re.sub(r"\W", "_", name, flags=re.ASCII)
        stands = _topic(writer, f"{topic}/stands", ("std_msgs/msg/Bool", "bool data", (), False))
        kind = ("geometry_msgs/msg/Vector3Stamped", definition, (HEADER, TIME, VECTOR), False)
        force = _topic(writer, f"{topic}/force", kind)
        points.append((stands, force))
    for index, instant in enumerate(instants):
        phase(instant, {"data": int(contacts["phase"][index])})
        acting = zip(points, contacts["contacts"][index], contacts["forces"][index], strict=True)
        for (stands, force), stand, vector in acting:
            stands(instant, {"data": bool(stand)})
            numbers = dict(zip("xyz", vector.tolist(), strict=True))
            force(instant, {"header": _header(instant, world), "vector": numbers})


def _topic(writer: Any, topic: str, kind: Topic) -> Callable[[int, Mapping[str, Any]], None]:
    """Begin a topic; return a function that writes a message of an instant, ns, into it."""
    encoders = import_optional("mcap_ros2._dynamic", name="mcap-ros2-support", element="format", extra="mcap")
    name, fields, uses, is_stored = kind
    rule = "=" * 80
    text = fields
    for used, definition in uses:
        text += f"\n{rule}\nMSG: {used}\n{definition}"
    schema = writer.register_schema(name, "ros2msg", text.encode())
    channel = writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": LATCHED if is_stored else ""})
    encode = encoders.serialize_dynamic(name, text)[name]
    return lambda instant, message: writer.add_message(channel, instant, encode(message), instant)


def _header(instant: int, frame: str) -> dict[str, Any]:
    return {"stamp": {"sec": instant // 10**9, "nanosec": instant % 10**9}, "frame_id": frame}


def _transform(instant: int, parent: str, child: str, pose: Array) -> dict[str, Any]:
    """A ``TransformStamped``; ``pose`` (7,) is x, y, z, quaternion x, y, z, w."""
    numbers = pose.tolist()
    transform = {
        "translation": dict(zip("xyz", numbers[:3], strict=True)),
        "rotation": dict(zip("xyzw", numbers[3:], strict=True)),
    }
    return {"header": _header(instant, parent), "child_frame_id": child, "transform": transform}
