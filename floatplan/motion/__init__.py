"""How the robot flies: sine polynomials, momentum, ballistics, torques and clearance, at given instants.

Other rooms ask :func:`floatplan.motion.flight.flight_of`, which answers for both kinds of flight; numbers in
parentheses are the equations of the paper.

Frames
------
plane
    Points are complex numbers, horizontal + i vertical; angles count about the plane's normal. sigma is the plane's
    ``turn``: +1 where a positive angle turns the horizontal axis towards the vertical one, else -1.
W, B
    In space: the world, z up, its axes those of the root link at the identity; and the base, whose axes turn with the
    root link. An attitude R takes vectors of B to W. A small turn zeta is of the world's axes: ``R -> exp([zeta]x) R``.
    Names end with the frame where a reader could doubt it, as ``mean_inertia_B``.

Symbols
-------
====================  ==========================================================================================
n, e                  planned joints; directions in which the base turns: 1 in a plane, 3 in space
T; s                  ``duration``, s; t/T, from 0 at takeoff to 1 at landing
p, b, z               ``q = centre + amplitude sin p``, (12); coefficients b of p by powers of t in seconds, and z (n,
                      width) of its free polynomials, by which p moves in rad, root mean square
h                     ``angular_momentum`` (e,) about the centre of mass, kg m^2/s; in space in W
D = (D_0 .. D_n)      momentum map of a plane: ``D_0 theta_0' + sum_i D_i q_i' = h``, (4), kg m^2
I, A                  in space ``I omega + A q' = R^T h``: inertia (3, 3) and momentum map (3, n), kg m^2, in B
omega                 angular velocity (3,) of the base in B, rad/s
C, W                  of a planar tree: coupling (m, m), kg m^2; weights (m,) by which rotations give a point, m
K, N                  instants; nodes of a quadrature
====================  ==========================================================================================
"""
