"""Access: accounts, tokens, the certificate; values and files, nothing of the web."""
