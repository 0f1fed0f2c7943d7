"""Jumps in space: rolls, twists and turns, from standing to standing, on points, soles, or balls that roll.

In order of reading: standing, phases and setup say what stands where; model, nodes, pieces and program are the program,
impact is what it has where feet land with speed, guess is where it begins; flight is what is planned between its
stances; coordinates, exact, pendulum and stance make motions of a solution; jump_motion is what the check judges;
planner calls them; stance_search is one stance by itself, for launches and clips; conflicts says what binds; jump is
the result.

Glossary
--------
y, v, a : (6+n,) centre of mass, m, three Euler angles of the base and planned joints q, rad; their derivatives; in
    grids of stances, and in motions (3, 6+n, N), with the base's origin in position of the centre of mass
axes : the letters of the angles' axes, R = R_a R_b R_c; chosen so that the middle one stays small
node, border : an instant of the program; the one at which two phases meet
kind : what holds at a node: which feet track their places, which arrive, which bear forces
frame, name : of a foot the robot's frame, and that of one of its points: of a sole the frame's with a suffix, else the
    frame's own
share : of a force that over the weight, of a time that over its phase's duration, else that of a limit
step : of the ground, from one height to another
near : at a tolerance, as in the vicinity of; an index of a motion's end, 0 or -1, that of the end from which one begins
World axes are those of the root link at the identity, z up; the origin of a program is below the centre of mass where
the robot stands, on the ground.
"""
