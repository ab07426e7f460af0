"""Steady motions: states of rest and periodic motions of all kinds of loop, closed on one flow."""
