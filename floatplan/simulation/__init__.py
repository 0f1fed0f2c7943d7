"""Does a plan fly? Forward dynamics under its torques, open loop and with control, in the air and on the ground.

`replay.py` reads only records. Control loops use the plan or the jump itself, `closed_loop.py` a replanner also where
nothing is corrected.

- `reduced_model.py`: the robot of a flight in Pinocchio; `plan_motion.py`, `spatial_motion.py`: the motion that a plan
  file states, its torques by inverse dynamics, and how it takes off.
- `perturbation.py`: what a plan does not know, sampled by seed; `gains.py`: stiffness and damping of joints;
  `limits.py`: how much one call simulates.
- `engines.py`: accelerations by Pinocchio or MuJoCo; `integration.py`: Runge-Kutta methods; `mujoco_model.py`: the one
  model for MuJoCo, on a planar base or on a free joint; `contact`: the same with feet, links and the
  ground, and a motion as controllers track it there, a jump or a recorded one.
- `replay.py`: torques as functions of time, integrated far more finely than anything that it checks;
  `free_flight.py`: a plan in a plane with its base free in space.
- `control_loop.py`: control at a fixed period: measure, correct, control, move. `closed_loop.py` runs plans by it,
  `motion_run.py` motions on the ground, `jump_run.py` jumps among these with corrections in flight, and
  `jump_replay.py` many robots of a jump; `results.py`: how such runs landed, `simulated_jump.py`: the motion that a
  robot made of a jump.

A flight is a time in the air, of which a motion may have several. A run is one robot's way through the whole motion;
in public names the number of runs is `flights`.

To add what goes wrong in a simulation (`--perturb`):

- in `perturbation.py` its row in `KINDS`; its name in `MEASURED`, `OF_TAKEOFF` or `WITH_CONTACT` where it is one of
  these; a field of `Perturbation` and one of `Sample`; and its random numbers at the end of `sampled`, sampled only
  `if` its size is not zero, so that robots and noise of all seeds stay as they were;
- what feels it: `Sample.perturbed` and with it `PinocchioRobot` of `engines.py`; `MujocoSpec` of `mujoco_model.py`;
  `ContactRobot` of `contact/model.py`; at takeoff `perturbed_takeoff`, in measurements `Sensors` of `control_loop.py`;
  what changes in the course of a run, a push for instance, is set in each period of `MotionControl.track` of
  `motion_run.py`;
- in `closed_loop.py`, where it changes when the robot lands: the centre of mass is then measured;
- its words in `cli/motions.py`, `cli/clips.py` and `docs/in_flight.md`, of motions with contact in
  `docs/howto/flip_in_mujoco.md`, `docs/howto/bench.md` and the docstrings of `bench` and `replay_jump`, and in
  `CHANGELOG.md`;
- a row of `tests/simulation/test_perturbation.py`.

To add an engine: a class with the members of `PinocchioRobot`, and its name in
`Engine` and `CHOICES` of `tables.py`.

Symbols, in SI units and radians throughout:

- m joints move, n of them are planned: `selection` (nv, n) says which move how far with each planned joint.
- q, v: a configuration and its velocity, the base's entries first. In a plane (3 + m,) each: horizontal and vertical
  position and orientation, in the world's axes. In space (7 + m,) and (6 + m,): position in the world, quaternion x, y,
  z, w, and the base's linear and angular velocity in its own axes, as Pinocchio has them.
- own_q, own_v: the same in MuJoCo's coordinates: joints in its order, quaternions w, x, y, z, the base's linear
  velocity in the world's axes.
- h: angular momentum about the centre of mass, kg m^2/s, in the world's axes.
- f: forces on v, N m and N; zero for the base.
"""
