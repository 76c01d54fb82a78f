"""python-can without what it would bring along.

It tries to import asammdf for files that nobody reads here; where that is installed (for exports) it brings pandas and
pyarrow: 80 MB and two seconds of every start.
"""

import sys

_hides_asammdf = "asammdf" not in sys.modules
if _hides_asammdf:
    sys.modules["asammdf"] = None  # type: ignore[assignment]
try:
    import can as can
finally:
    if _hides_asammdf:
        del sys.modules["asammdf"]
