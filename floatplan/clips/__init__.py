"""Recorded motions of robots: read, judged whether their flights can fly, repaired so that they do, and written back.

Motions that learners are fed with are often recorded of people and carried over to a robot. In the air such a motion
obeys two laws or none: the centre of mass falls on a parabola, and the angular momentum about it is constant. What is
computed, and why so: `docs/theory/clips.md`.

- `formats.py`, `pickles.py`, `loading.py`: files in, by format; `writing.py`: files out.
- `clip.py`: frames, robot, ground; `curve.py`: the motion between the frames; `flights.py`: feet, ground, flights.
- `fall.py`: the parabola of the centre of mass; `turning.py`: the base's rotation by one momentum; `judge.py`: the
  verdict on a flight; `check.py`: on all flights of a clip; `page.py`: the page about it.
- `repair.py`: the repair of a clip and the report on it; `repaired_flight.py`: a flight planned anew; `timing.py`: the
  clip's time around it; `bent_stances.py`: stances that meet it; `stance_forces.py`: what these would take;
  `repaired_motion.py`: all of it as one motion; `repair_page.py`: the page about it.
- `planned/`: stances that are planned instead of bent, by the program of jumps' stances.

Symbols and frames
------------------
world     z up; gravity points along -z
base      the robot's root link; its frame turns with it
N, J      frames of the clip; joints of the robot that move, in the order of ``robot.model_joints``
c         centre of mass (3,), m, in the world; its acceleration in a flight is (0, 0, -g)
R         attitude (3, 3) of the base: it takes vectors of the base to the world
q         positions (J,) of the joints, rad (m where they slide)
h         angular momentum (3,) about the centre of mass, in the world, kg m^2/s
[I | A]   inertia (3, 3) and joint map (3, J), kg m^2, in the base's axes: ``R^T h = I omega + A q'``
g         9.81 m/s^2 unless another value is set
"""
