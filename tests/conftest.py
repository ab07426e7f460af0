"""Settings of all tests: the same random examples in every run, pictures without a screen."""

from __future__ import annotations

import matplotlib as mpl
from hypothesis import HealthCheck, settings

mpl.use("Agg")

# Derandomised, so that a run never fails by luck; no deadline, because the first call of a kernel compiles it.
settings.register_profile(
    "fixed", derandomize=True, deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("fixed")
