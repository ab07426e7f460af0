"""Thousands of random loops against independent codes: hours of work that the usual tests do not do.

``python -m tests.stress --runs 2000 --searches 1000 -o stress.json`` makes the figures of the documentation's page on
trust; pytest collects this folder only where it is named (``pytest tests/stress``).
"""
