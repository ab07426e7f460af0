"""Bounds where a limit cycle of some size is allowed."""
