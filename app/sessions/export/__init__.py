"""A session's signals as files that other programs open."""
