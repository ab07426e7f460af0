"""Pictures and tables of the pages on methods."""
