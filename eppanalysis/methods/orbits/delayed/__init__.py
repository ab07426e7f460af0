"""Orbits of loops whose delayed signals move."""
