"""A robot on the ground in MuJoCo.

- `shapes.py`: what of a robot touches the ground, feet and other links.
- `tracked_motion.py`: a motion as controllers track it, a jump or a recorded one.
- `model.py`: the robot with its shapes in MuJoCo, and what its contacts measure.
"""
