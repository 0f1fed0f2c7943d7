"""Flight in space: attitudes follow from a differential equation. Frames and symbols: :mod:`floatplan.motion`."""
