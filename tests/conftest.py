"""Settings of all tests: the same random examples in every run, pictures without a display."""

from __future__ import annotations

import os
import signal
import threading

# As the command line has it; numpy asks when it is imported. Threads of several test processes get in each other's way.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import matplotlib as mpl
from hypothesis import HealthCheck, settings

mpl.use("Agg")

# Derandomised, so that a run never fails by luck; no deadline, because the first call of a kernel compiles it.
settings.register_profile(
    "fixed", derandomize=True, deadline=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("fixed")

# A shell starts what runs in its background with interrupts ignored, and children inherit that; the tests send some.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)
