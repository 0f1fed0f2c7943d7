"""Jumps in space: rolls, twists and turns, from standing to standing, on points, soles, or balls that roll.

In order of reading: standing, phases and setup say what stands where; model, nodes, pieces and program are the program,
impact is what it has where feet land with speed, guess is where it begins; flight is what is planned between its
stances; coordinates, exact, pendulum and stance make motions of a solution; jump_motion is what the check judges;
planner calls them; stance_search is one stance by itself, for launches and clips; conflicts says what binds; jump is
the result.

Glossary
--------
y, v, a : (6+n,) centre of mass, m, three Euler angles of the base and planned joints q, rad; their derivatives; in
    grids of stances, which are those of files, with the base's origin instead of the centre of mass
motion : (3, 6+n, N) the base's origin, its three angles and planned joints, with two derivatives
com_motion : the same with the centre of mass instead of the base's origin: y, v and a of a program
axes : the letters of the angles' axes, R = R_a R_b R_c; chosen so that the middle one stays small
node, border : an instant of the program; the one at which two phases meet
kind : what holds at a node: which feet track their places, which arrive, which bear forces
frame : of the robot; that of a foot has the foot's points, one, or three of a sole
name : of a foot's point, by which places and forces are listed: of a sole the frame's with a suffix, else the frame's
share : of a limit or another whole; forces over the weight are scaled, times over durations progress
planned forces : N, of the program, linear between its nodes; the feet's are as near to them as the motion's wrench lets
flight_end, fixed_end : index, 0 or -1, of the end of a motion next to the flight; of that from which it is integrated
arrival, landed : rates and accelerations with which a flight ends; the motion after it: of an impact with other rates
step : of the ground, from one height to another
near : of values, to which others are to be near; of ``fp.jump`` the jump from whose motion its search begins
World axes are those of the root link at the identity, z up; the origin of a program is below the centre of mass where
the robot stands, on the ground.
"""
