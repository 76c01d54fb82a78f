"""Answers of the service: the shapes for OpenAPI and for the front end's generated types. null = missing."""
