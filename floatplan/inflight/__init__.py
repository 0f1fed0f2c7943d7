"""While it flies: corrections of a plan's motion, from what is measured on the way.

- `replanner.py`: :class:`~floatplan.inflight.replanner.Replanner`, the one public way in: a measurement goes in, the
  joints' motion from now to the landing comes out.
- `planar.py`, `spatial.py`: what the two kinds of flights are made of, by the same names, and ideal robots of each;
  `orientation.py`: how orientations are computed with. All else is the same for both.
- `measurement.py`: what a measurement is, and whether it can be one; `estimate.py`: the state that follows from it.
- `remaining_motion.py`: the remaining flight; `prediction.py`: the instants at which it is evaluated, and the rows of
  the problem's limits there; `update.py`: the kernel's input and output, which computes all of an update.
- `warm_starts.py`: where the first correction begins; `authority.py`: how much corrections can do.

Symbols, in SI units and radians throughout; times are s since takeoff:

- n joints are planned; m is the number of free polynomials of each joint, of motors where torques are meant.
- e numbers each turn the base, are its momentum, and a miss: 1 in a plane, 3 in space.
- q, q': positions and rates of the planned joints; theta0: orientation of the base, h: angular momentum, with
  h = D(q) . (theta0', q'); in space R, from the base's axes to the world's, and h = R (I(q) omega + A(q) q').
- p: polynomial of a joint, q = centre + amplitude sin(p); u: share of the remaining time, from 0 to 1.
- y: changes of the free polynomials, scaled so that their size is that of the acceleration that they make.
- the miss: orientation at landing less the goal; in space the vector of the rotation log(R_goal^T R).
- a row: one limit at one instant, satisfied where it is at least zero.
"""
