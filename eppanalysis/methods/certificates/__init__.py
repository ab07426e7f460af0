"""Proofs: statements about a loop that a small program checks again, by balls and rational numbers, from a file."""
