"""Frozen systems: linear parts, elements, loops, and their hybrid form."""
