"""A linear part that is known by its measured frequency response alone."""
