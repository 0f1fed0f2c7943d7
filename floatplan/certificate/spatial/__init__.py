"""Flights in space: what is proved of their attitude, momentum, limits and torques.

Symbols, as in ``docs/theory/space.md``: R, the attitude of the base, takes vectors of the base's axes to the world's; h is
the angular momentum in the world. Everything else is in the base's axes: ``R_b`` is the rotation of body b relative to
the base, ``I`` the inertia about the centre of mass, ``relative`` the angular momentum ``A q'`` that the joints' rates
make, ``omega`` the base's angular velocity. SI units and radians.
"""
