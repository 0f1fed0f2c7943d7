"""Stances of a repaired clip that are planned, not bent: by the program of a jump's stances, near to the clip.

In order of reading: contacts says which feet stand when, and where; ends makes flights that still feet leave and end;
planner plans what is between, and says what is in the way where there is none.
"""
