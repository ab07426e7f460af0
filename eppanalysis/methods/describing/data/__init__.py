"""What a prediction from measured data takes from them: cycles, their intervals, their stability."""
