"""Whole jumps: stance, flight, stance. One program over all phases, then the flight's plan and stances that fit it.

In order of reading: contacts and phases say what stands when; model, locked_joints, rows, separation, variables and
program are the program; motion has stances as functions of time, jump_motion all of a jump, which check judges; setup
makes programs of a request, rounds says which one follows a solution; flight and exact make motions of the solution;
planner calls them, as ``launches`` does for one stance; conflicts says why there is none; jump and reading are the
result and its file. The folder ``spatial`` is the same in space, most modules by the same names.

Glossary
--------
phase : a time in which the contacts do not change; of a side, "takeoff", "flight" or "landing"
contact, anchor, others : a point on which the robot stands, with those coupled to it; the one that stands in all phases
    of its side, from which positions are measured; and the phase's contacts but the anchor, whose forces are variables
node : an instant of the program; densest next to the flight
seam : the instant at which a stance meets the flight; of a phase also its node towards the flight
junction : the instant at which feet come or leave between two stances
inner, outer : of two phases of a side that next to the flight and the other; of a phase its ends, likewise
towards_flight : the phase that a phase meets on the side of its flight, be it the flight or the inner one
flight_number : of a sequence's flights, from 0; of a stance that of the flight to which it leads, or that it follows
hop : a jump without turns
y, v, a : (n+1,) orientation theta_0 of the base and planned joints q, rad; their first and second derivatives
phi, e : angles of the bodies, rad, and their rotations exp(i sigma phi); sigma is the plane's ``turn``, 1 or -1
h : angular momentum of the flight about the centre of mass, kg m^2/s
closing acceleration : of a foot, over g, with which its chain is closed at both ends of a phase
ground, ground_from_com, rise : height of a ground in the world; seen from the centre of mass, standing; over the ground
    of the first stance, m
released : of accelerations at a seam, those of a robot that falls freely while its feet do not move yet
reserve : by how much more than its margin a distance is required at nodes, m
shortfall : by how much distances miss that, where all else of a program holds, m
Positions are pairs (horizontal, vertical) or complex numbers, horizontal + i vertical, m: of points of the robot from
its centre of mass or from the anchor; of the world from the takeoff of the flight. The program is scaled by the weight,
N, the height of the centre of mass where the robot stands, m, and the time of a fall by it, sqrt(height / g), s.
A ratio is a horizontal over a vertical force; a share is that of a limit; a margin is what a program leaves of one.
"""
