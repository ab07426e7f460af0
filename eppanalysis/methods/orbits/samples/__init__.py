"""Limit cycles of loops in discrete time and of sampled loops: orbits that are locked to the samples, or not."""
