"""How fast the master opens the shutdown circuit, measured from recorded bytes, as a document for the scrutineers."""
