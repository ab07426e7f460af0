"""Devices: loops that are made of physical parameters."""
