"""Results as tables: data frames, tables of the console, files."""
