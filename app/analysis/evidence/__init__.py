"""Reaction times of the master, measured from recorded bytes, as a document for the scrutineers."""
