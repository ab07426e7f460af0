"""Prediction: first-order harmonic balance with bias, margins, the Nyquist picture, and how far off it may be."""
