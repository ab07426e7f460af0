"""The compiled engine: the module that was built for this machine, or of those in a wheel the one for its processor."""

import sys

from eppanalysis.engine import _native

if _native.AVX2:
    from eppanalysis.engine import _native_avx2 as _native

sys.modules[__name__] = _native
