"""Bounds of gains and of backlash within which no limit cycle exists."""
