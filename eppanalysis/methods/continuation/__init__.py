"""Branches of exact orbits over a parameter, their folds, borders and period doublings."""
