"""Compiled code: floats and arrays in, floats and arrays out."""
