"""Vectors and tuples in compiled code."""
