"""The robot in its plane: which joints move, as bodies, as a Pinocchio model."""
