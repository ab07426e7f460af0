"""Bounds of designs whose parameters carry tolerances."""
