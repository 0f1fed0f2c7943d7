"""Curves of a flight over time: angles, rates, torques, momentum and clearance; a second plan is drawn dashed."""
