"""A package, so that `browser` ends with its last test: Playwright's event loop runs in the test's thread."""
