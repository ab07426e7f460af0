"""Harmonic balance of any order."""
