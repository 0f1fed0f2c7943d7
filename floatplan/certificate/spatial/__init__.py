"""Flights in space: what is proved of their attitude, momentum, limits, torques and clearances.

Symbols, as in ``docs/theory/space_proof.md``: R, the attitude of the base, takes vectors of the base's axes to the
world's; h is the angular momentum in the world. Everything else is in the base's axes: ``R_b`` is the rotation of body
b relative to the base, ``I`` the inertia about the centre of mass, ``relative`` the angular momentum ``A q'`` that the
joints' rates make, ``omega`` the base's angular velocity. SI units and radians.

The data flow is the order of the files: ``robot`` (constants), ``bodies`` (what the joints do alone), ``attitude`` (an
approximation) and ``bound`` (how far it is off), ``torques``, ``flight`` (on cells that are as fine as needed),
``findings``; ``clearance`` (where the links' shapes are, and how far apart) and ``obstacles`` (from what).
"""
