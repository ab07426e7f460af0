"""Elements with linear states or a clock of their own: limited rates, sampled controllers."""
