"""Whole jumps: stance, flight, stance. One program over all phases, then the flight's plan and stances that fit it.

In order of reading: contacts, phases and setup say what is asked; model, rows, program, separation and exchange solve
it; flight, motion and exact make motions of the solution, which check judges; planner and launch call them.
"""
