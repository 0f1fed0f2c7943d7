"""A first problem file for any robot: a jump from standing to standing, else a flight afloat that joints rotate.

In order of reading: options are what is requested; robots choose plane, joints, couplings, feet and posture, by legs,
feet and standing; flight searches, afloat and separation with it; shortcomings and text report the result.

Glossary
--------
frame, foot : a link or joint by name; one on which the robot can stand, the end of a limb
leg : a limb of bodies from the hip over the knee to the foot; it steps if it can shorten
reference posture : of the robot's file, in which joints that are not planned are locked
y, positions : (n+1,) orientation and planned joints, rad; (n,) only the joints
rotation : of the base, rad; positive ``turns`` of a jump are backwards
Positions of points are complex numbers, horizontal + i vertical, m, from the centre of mass.
"""
