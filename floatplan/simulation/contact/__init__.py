"""A robot on the ground in MuJoCo.

- `shapes.py`: what of a robot touches the ground, feet and other links; `model.py`: the robot with these, and what its
  contacts measure.
"""
