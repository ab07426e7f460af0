"""Rivals on the same work, alternately, in one run, ratios with accuracy: ``python -m benchmarks``."""
