"""Prediction: DF harmonic balance with bias, margins, the Nyquist plot, and how far off it may be."""
