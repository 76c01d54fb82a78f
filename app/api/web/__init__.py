"""The common part of all routes: authentication, limits, problem documents, static files."""
