"""Dither: what a fast oscillation at an element's input makes of the element, and the least that removes a cycle."""
