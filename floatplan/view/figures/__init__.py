"""Figures, kinograms and films."""
