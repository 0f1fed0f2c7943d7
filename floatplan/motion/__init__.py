"""How the robot flies: sine polynomials, momentum, ballistics, torques and clearance, as values and Jacobians."""
