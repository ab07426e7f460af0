"""Loops: linear part, elements around it, inputs, and the hybrid system made of them."""
