"""Design guidelines for any two parameters of any case."""
