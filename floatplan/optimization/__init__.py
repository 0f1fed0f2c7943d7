"""Nonlinear programs and how they are solved; knows no robot."""
