"""The analyses: from a system to a prediction, a simulation, an orbit, a bound."""
