"""Loops driven by a sine: their periodic responses, exactly and by the DF, over frequency and amplitude."""
