"""A rational model of a measured frequency response."""
