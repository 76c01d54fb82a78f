"""The production engine of the filters: C99 sources, the shared library built from them, and its wrapper.

`hatch_build.py` builds the library, for a checkout next to the sources and for a wheel into it. The plain
equations it has to compute are in `tests/oracle`.
"""
