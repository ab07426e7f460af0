"""Loops with sampled controllers: when they are observed, and their equivalents in continuous time."""
