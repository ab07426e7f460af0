"""Loops from and to python-control."""
