"""Whole jumps: stance, flight, stance. One program over all phases, then the flight's plan and stances that fit it."""
