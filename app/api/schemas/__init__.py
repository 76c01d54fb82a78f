"""What the service answers: the shapes for OpenAPI and for the front end's generated types. null = missing."""
