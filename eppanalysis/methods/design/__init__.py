"""Designs without a limit cycle, or with none above what is allowed, at the least price."""
