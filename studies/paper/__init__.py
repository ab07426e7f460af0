"""Everything the pages on the paper show."""
