"""Flights in space: what is proved of their attitude, momentum, limits, torques and clearances.

Symbols, as in ``docs/theory/space_proof.md``: R, the attitude of the base, takes vectors of the base's axes to the
world's; h is the angular momentum in the world. Everything else is in the base's axes: ``R_b`` is the rotation of body
b relative to the base, ``I`` the inertia about the centre of mass, ``A q'`` the angular momentum that the joints' rates
make, ``omega`` the base's angular velocity. SI units and radians.

The words of this package:

cell
    A short interval of the flight, on which time is ``u`` in [-1, 1]; halved until it is as fine as the proof needs.
model
    A polynomial of u with a radius: the function that it stands for is within that at every instant of the cell.
    ``Taylor`` are models of scalars, the cells second in their arrays, and ``Matrices`` of matrices, the cells first.
ball
    A number with a radius, ``Balls``: a constant, or a model at one instant.
item, member
    One piece of a cell on which a least value may be, as branch and bound splits it; which of the functions it is of.
    Its Bernstein form has coefficients between whose smallest and largest all values are.
approximation, bound
    A polynomial attitude that doubles find, and the angle within which the true attitude is of it: enclosures of the
    true flight are those of the approximation, wider by the bound.
momentum_in_base, joint_momentum
    ``R^T h``, and ``A q'``: ``omega = I^-1 (momentum_in_base - joint_momentum)``.
residual, amplification, condition
    r, s and q of the theorem in ``bound``: how far the approximation is from solving (S1), by how much a small rotation
    grows, and what has to be below 1.
segment, solid
    A link's shape: what is within a radius of a straight line; the hull of points grown by an ellipsoid, for heights.

The data flow is the order of the files: ``robot`` (constants), ``bodies`` (what the joints do alone), ``attitude`` (an
approximation) and ``bound`` (how far it is off), ``torques``, ``flight`` (on cells that are as fine as needed),
``findings``; ``clearance`` (where the links' shapes are, and how far apart) and ``obstacles`` (from what).
``models`` are the models of matrices, ``out_of_plane`` is about plans in a plane.
"""
