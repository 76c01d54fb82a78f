"""The filters compiled to machine code. The equations are those of the numpy filters."""
