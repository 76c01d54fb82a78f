"""What every route shares: authentication, limits, problem documents, static files."""
