"""How good a motion is as a reference: disturbed robots track it in MuJoCo by one fixed controller.

- `tracked_clip.py`: a recorded motion as controllers have it: joints, torques by inverse dynamics, feet.
- `bench.py`: many robots track a jump or a recorded motion, and are counted where they land.
"""
