"""What counts as kept: one tolerance for one statement, the same for the search and for the certificate.

The search aims inside its constraints (``BACK_OFF`` of the transcription); what it ends with is judged
by these, as the certificate judges it.
"""

ORIENTATION = 1e-8  # [rad] at the end of the flight
BOUNDARY = (1e-8, 1e-7, 1e-5)  # [rad, rad/s, rad/s^2] of (13)
CLEARANCE = 1e-8  # [m] also where a foot or hand touches the ground: 0 there
AT_REST = 1e-9  # [m/s] of a frame that leaves or meets the ground at rest
PLACE = 1e-8  # [m] takeoff frame, landing frame
RELATIVE = 1e-9  # [-] of every limit of a magnitude: velocity, acceleration, torque, orientation rate
RANGE = 1e-12  # [rad] of joint ranges
