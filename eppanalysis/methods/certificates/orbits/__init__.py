"""Periodic orbits proved in ball arithmetic: that they exist, their events, period and multipliers."""
