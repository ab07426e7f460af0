"""Compiled: closed orbits as chains of arcs between events, with the derivatives that Newton's method needs."""
