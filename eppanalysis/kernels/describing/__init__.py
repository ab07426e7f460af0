"""Describing functions of single elements under a biased sine."""
