"""Exact periodic orbits: the equations of one, and how it is closed."""
