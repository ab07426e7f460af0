"""Event-exact runs: one loop, a batch of them, the iteration in discrete time, and what a run settles on."""
