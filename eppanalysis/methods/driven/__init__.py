"""Loops driven by a sine: their periodic responses, exactly and in first order, over frequency and amplitude."""
