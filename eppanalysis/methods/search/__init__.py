"""All limit cycles of a loop, and what starts them: smallest disturbances and basins of attraction."""
