"""Margins of the linearised loop, cut open at any place: exact in the frequency domain, dead time included."""
