"""What the kernel is given of a flight: its robot, its rows and its numbers, in the plane and in space.

Of the rest of planning only ``spec`` and ``kernel_problem`` know which flight it is. Corrections in flight and the
peaks of studies fill the kernel's structs with these modules too: ``bodies`` is the robot of a flight in the plane;
``rows`` are the inequalities; ``space`` is what a flight in space has of its own; ``numbers`` are what problems of a
family differ in.
"""
