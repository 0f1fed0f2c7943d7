"""Stances that meet a plan: a search for robots in a plane, which hands others on to one in space; and its result."""
