"""Nonlinear programming, independent of robots."""
