"""Loops with sampled controllers: when they are looked at, and what stands for them in continuous time."""
