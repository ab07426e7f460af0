"""Slow reference simulations, written from the equations alone, that witness what the package computes."""
