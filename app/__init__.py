"""The program: links, shadow image, pipeline, sessions, API, command line."""

__version__ = "0.1.0"
