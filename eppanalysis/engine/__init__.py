"""The engine, in C++: the run from event to event, orbits, describing functions, balances.

The functions take arrays and named tuples of arrays, look at them in place and fill them; other threads of Python run
meanwhile. The sources are in ``src``; docs/theory/engine.md says what they compute.
"""
