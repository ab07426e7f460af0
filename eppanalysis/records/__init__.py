"""Records from the files that people have: every format is opened as one kind of table, and read in one way."""
