"""The DF, harmonic balance, exact orbit and simulation of one loop side by side."""
