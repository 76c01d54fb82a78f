/* What a program that loads the engine as a shared library asks first: does it fit? */
#include "vw_filter.h"

#ifndef VW_SOURCES
#define VW_SOURCES "unknown"
#endif

/* SHA-256 of the sources that the library was built from, in hexadecimal. */
const char *vw_library_sources(void) { return VW_SOURCES; }

int32_t vw_library_size_of_filter(void) { return (int32_t)sizeof(vw_filter); }

int32_t vw_library_size_of_cells(void) { return (int32_t)sizeof(vw_cells); }
