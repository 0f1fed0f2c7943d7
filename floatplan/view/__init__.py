"""Pictures of plans: figures, films, the report and the scene.

Words and symbols that this package shares:

segment
    What moves as one in a picture, and has one colour: 0 is the base with what is fixed to it, i + 1 is what joint i
    moves. Curves of a joint belong to its segment.
body
    A body of the robot's tree of masses in the plane, or of its Pinocchio model in space; a segment may have several.
posture
    The robot at an instant, as outlines in a picture; ``K`` instants, ``S`` shapes.
pose
    Position and attitude of every body at an instant.
camera
    In a plane pictures are seen along its normal, in space from ``solids.CAMERA``. Positions in a picture are complex:
    to the right + i upwards, m.
column
    Samples (N,) of a quantity over time, by name, SI units and radians; of joint, motor or contact i it ends in ``.i``.
contact
    Points that a robot stands on and that act as one, such as both feet of a pair.
"""
