"""The filters in plain numpy, written like the equations: state in, state out.

It says what the C engine has to compute, file by file and name by name, and it runs where no shared library fits.
"""
