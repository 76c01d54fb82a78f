"""The production engine of the filters: C99 sources, the shared library built from them, and its wrapper.

`hatch_build.py` builds the library, for a checkout beside the sources and for a wheel into it. The reference that says
what it has to compute is `app.estimation.filters.reference`.
"""
