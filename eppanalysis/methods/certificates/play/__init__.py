"""Loops with play proved to have no periodic motion, by functions that are quadratic in sectors."""
