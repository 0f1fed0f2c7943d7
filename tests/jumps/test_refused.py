"""Stances that cannot be: each refused with its key and the reason, before anything is solved."""

from dataclasses import replace

import pytest
from jumps import go2_problem

import floatplan as fp
from floatplan.robot import Robot

STANDING = dict(
    zip(("FL_thigh_joint", "FL_calf_joint", "RL_thigh_joint", "RL_calf_joint"), [0.8, -1.4] * 2, strict=True)
)
REFUSED = {
    "the knee": ([["FL_calf"]], "standing", r"contacts: 'FL_calf' is a point \d+ mm above .*such as 'FL_foot'"),
    "the hip": ([["FL_thigh"]], "standing", r"contacts: 'FL_thigh\.tip' is in the air: 'F[LR]_foot' is \d+ mm lower"),
    "a locked joint's link": (
        [["FL_hip"]],
        "standing",
        r"contacts: 'FL_hip' is in the air: 'F[LR]_foot' is \d+ mm lower",
    ),
    "a foot twice": ([["RL_foot", "RL_foot"]], "standing", "contacts: 'RL_foot' stands twice"),
    "a foot and its twin": (
        [["RL_foot", "RR_foot"]],
        "standing",
        "contacts: 'RR_foot' stands twice: with 'RL_foot', 'RR_foot'",
    ),
    "a toe of a point": (
        [["RL_foot.toe"]],
        "standing",
        "contacts: 'RL_foot.toe' is no point of a sole; name 'RL_foot'",
    ),
    "nothing under the mass": (
        [["RL_foot"]],
        STANDING,
        r"from: the posture is not static: its centre of mass is \d+ mm outside its feet, ahead of 'RL_foot'; static",
    ),
    "legs aslant": (
        None,
        STANDING | {"FL_thigh_joint": 1.4, "RL_thigh_joint": 1.4},
        r"from: the posture is not static: its centre of mass is .* its feet",
    ),
    "one leg longer": (
        None,
        STANDING | {"RL_calf_joint": -1.75},
        "from: the posture is not static: its feet are .* apart in height",
    ),
    "a joint beyond its range": (
        None,
        STANDING | {"FL_thigh_joint": 7.0},
        r"from\.FL_thigh_joint: 7 rad is outside the joint's range, -1\.571 to 3\.491 rad",
    ),
}


@pytest.mark.parametrize("side", ["takeoff", "landing"])
@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_stand_is_refused(name, side):
    contacts, posture, reason = REFUSED[name]
    sides = {
        "takeoff": fp.JumpRequest(takeoff=fp.JumpTakeoff(contacts, from_=posture)),
        "landing": fp.JumpRequest(landing=fp.JumpLanding(contacts, to=posture)),
    }
    with pytest.raises(
        fp.InputError, match=rf"jump\.{side}\.{reason.replace('from', 'from' if side == 'takeoff' else 'to')}"
    ):
        fp.jump(go2_problem(), sides[side])


def test_the_base_s_own_frame_stands_nowhere():
    problem = go2_problem()
    free = replace(problem, flight=replace(problem.flight, takeoff=None))
    with pytest.raises(fp.InputError, match=r"flight\.takeoff: the frame there is the base's own"):
        fp.jump(free)


def test_shapes_that_are_missing_are_not_passed_over(monkeypatch):
    """What is wrong with the robot is refused; it is no jump that was not found."""

    def refuse(self):
        raise fp.InputError("a mesh is not to be found", source=self.source)

    monkeypatch.setattr(Robot, "check_shapes", refuse)
    with pytest.raises(fp.InputError, match=r"go2\.urdf: a mesh is not to be found"):
        fp.jump(go2_problem())


def test_legs_of_one_joint_cannot_stand_together(tmp_path):
    legs = "".join(
        f'<body name="{name}" pos="{place} 0 0"><joint name="{name}_hip" axis="0 1 0" range="-60 60"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02"/>'
        f'<body name="{name}_foot" pos="0 0 -0.3"><geom size="0.02"/></body></body>'
        for name, place in (("rear", -0.2), ("front", 0.2))
    )
    path = tmp_path / "table.xml"
    trunk = f'<body name="trunk"><freejoint/><geom type="box" size="0.3 0.1 0.05"/>{legs}</body>'
    path.write_text(f"<mujoco><worldbody>{trunk}</worldbody></mujoco>")
    robot = Robot.from_mjcf(path)
    flight = fp.Flight(0.3, takeoff=fp.Takeoff("rear_foot"), landing=fp.Landing("rear_foot"))
    still = fp.Posture(orientation=0.0, positions=[0.0, 0.0])
    feet = ["rear_foot", "front_foot"]
    asked = fp.JumpRequest(takeoff=fp.JumpTakeoff(contacts=[feet]), landing=fp.JumpLanding(contacts=[feet]))
    reason = "takeoff.contacts: the leg of '.*' has too few joints to stand beside"
    with pytest.raises(fp.InputError, match=reason):
        fp.jump(fp.Problem(robot, start=still, goal=still, flight=flight, jump=asked))
